// The `clearance` command line: arguments, one command, an exit code.
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <iostream>
#include <string>

#include "client/cli/bench.h"
#include "client/cli/context.h"
#include "client/cli/print.h"
#include "client/cli/watch.h"

namespace clearance::cli {
namespace {

int Fail(const Context& context, const absl::Status& status) {
  const int code = ExitCodeOf(status);
  if (context.json) {
    PrintJson({{"error",
                {{"code", std::string(absl::StatusCodeToString(status.code()))},
                 {"message", std::string(status.message())},
                 {"exit_code", code}}}});
  }
  std::cerr << "clearance: " << status.message() << "\n";
  return code;
}

int Main(int argc, char** argv) {
  Context context;
  CLI::App app(
      "Distances to the nearest obstacle in a world that moves.\n"
      "Exit codes: 0 ok, 2 usage, 3 not found, 4 bad data, 5 unavailable, 6 timeout.");
  app.name("clearance");
  app.require_subcommand(1);
  app.fallthrough();
  app.add_option("--server", context.server, "HOST:PORT, unix:PATH or the path of a socket")
      ->envname("CLEARANCE_SERVER")
      ->capture_default_str();
  app.add_option("--map", context.map,
                 "the map's id (default: default; ingest: the folder's name)");
  app.add_flag("--json", context.json, "one JSON document on stdout");
  app.add_option("--timeout", context.timeout_s, "seconds for one call")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--tls-ca", context.credentials.tls_ca,
                 "PEM file of the authority that signed the server's certificate: connect by TLS")
      ->envname("CLEARANCE_TLS_CA");
  app.add_option("--tls-cert", context.credentials.tls_certificate, "PEM file of this client's own")
      ->envname("CLEARANCE_TLS_CERT");
  app.add_option("--tls-key", context.credentials.tls_key, "PEM file of its key")
      ->envname("CLEARANCE_TLS_KEY");
  app.add_option("--tls-server-name", context.credentials.tls_server_name,
                 "the name in the server's certificate, where it is not the address's host");
  app.add_option("--token-file", context.token_file,
                 "file that holds this caller's token (or CLEARANCE_TOKEN holds it)")
      ->envname("CLEARANCE_TOKEN_FILE");
  if (const char* token = std::getenv("CLEARANCE_TOKEN")) context.credentials.token = token;
  for (const auto add :
       {AddIngest, AddQuery, AddCheck, AddObjects, AddInfo, AddSlice, AddMesh, AddGrid, AddHealth,
        AddMap, AddBench, AddWatch, AddSnapshot, AddTop, AddDoctor, AddDrain, AddVersion}) {
    add(app, context);
  }
  for (CLI::App* command : app.get_subcommands({})) {
    command->fallthrough();
    for (CLI::App* nested : command->get_subcommands({})) nested->fallthrough();
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const bool help = error.get_exit_code() == 0;
    if (help) return app.exit(error);
    std::cerr << "clearance: " << error.what() << "\nRun clearance --help, or clearance COMMAND "
              << "--help.\n";
    return kExitUsage;
  }
  const absl::Status status = context.run();
  return status.ok() ? kExitOk : Fail(context, status);
}

}  // namespace
}  // namespace clearance::cli

int main(int argc, char** argv) { return clearance::cli::Main(argc, argv); }
