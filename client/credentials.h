// How a client proves who it is, and whom it believes.
#pragma once

#include <string>

namespace clearance::client {

// Empty = plain text without a token: loopback and unix sockets.
struct Credentials {
  // Paths of PEM files. With `ca` the connection is TLS to a server that this authority signed;
  // certificate and key are this client's own, where the server asks for one.
  std::string tls_ca{}, tls_certificate{}, tls_key{};
  std::string tls_server_name{};  // the name in the server's certificate; empty: the address's host
  std::string token{};            // sent with every call as a bearer token
};

}  // namespace clearance::client
