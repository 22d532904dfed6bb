#include "server/service/access/tls.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <cstdio>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

constexpr unsigned kReloadSeconds = 5;

template <typename T, void (*kFree)(T*)>
struct Free {
  void operator()(T* p) const { kFree(p); }
};
using Certificate = std::unique_ptr<X509, Free<X509, X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Free<EVP_PKEY, EVP_PKEY_free>>;
struct CloseFile {
  void operator()(FILE* f) const { fclose(f); }
};
using File = std::unique_ptr<FILE, CloseFile>;

absl::StatusOr<File> Open(const std::string& path, const char* what) {
  File file(fopen(path.c_str(), "rb"));
  if (!file) return absl::NotFoundError(absl::StrFormat("%s %s: cannot be read", what, path));
  return file;
}

absl::StatusOr<Certificate> ReadCertificate(const std::string& path, const char* what) {
  absl::StatusOr<File> file = Open(path, what);
  if (!file.ok()) return file.status();
  Certificate certificate(PEM_read_X509(file->get(), nullptr, nullptr, nullptr));
  ERR_clear_error();
  if (!certificate) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s %s: holds no PEM certificate", what, path));
  }
  return certificate;
}

absl::Status CheckFiles(const TlsFiles& files) {
  const auto certificate = ReadCertificate(files.certificate, "security.certificate");
  if (!certificate.ok()) return certificate.status();
  absl::StatusOr<File> file = Open(files.key, "security.key");
  if (!file.ok()) return file.status();
  // A key behind a passphrase cannot be read by a service: no prompt.
  const auto no_passphrase = [](char*, int, int, void*) { return -1; };
  const Key key(PEM_read_PrivateKey(file->get(), nullptr, no_passphrase, nullptr));
  ERR_clear_error();
  if (!key) {
    return absl::InvalidArgumentError(
        absl::StrFormat("security.key %s: holds no PEM key without passphrase", files.key));
  }
  const bool matches = X509_check_private_key(certificate->get(), key.get()) == 1;
  ERR_clear_error();
  if (!matches) {
    return absl::InvalidArgumentError(
        absl::StrFormat("security.key %s: is not the key of %s", files.key, files.certificate));
  }
  if (files.client_ca.empty()) return absl::OkStatus();
  return ReadCertificate(files.client_ca, "security.client_ca").status();
}

}  // namespace

absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> TlsCredentials(const TlsFiles& files) {
  if (absl::Status s = CheckFiles(files); !s.ok()) return s;
  namespace tls = grpc::experimental;
  auto provider = std::make_shared<tls::FileWatcherCertificateProvider>(
      files.key, files.certificate, files.client_ca, kReloadSeconds);
  tls::TlsServerCredentialsOptions options(provider);
  options.watch_identity_key_cert_pairs();
  if (!files.client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return tls::TlsServerCredentials(options);
}

}  // namespace clearance
