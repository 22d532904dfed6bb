// What every command shares.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/esdf_client.h"

namespace clearance::cli {

using Json = nlohmann::ordered_json;

// Stable: scripts rely on them.
inline constexpr int kExitOk = 0, kExitInternal = 1, kExitUsage = 2, kExitNotFound = 3,
                     kExitBadData = 4, kExitUnavailable = 5, kExitTimeout = 6;
int ExitCodeOf(const absl::Status& status);

struct Context {
  std::string server = "127.0.0.1:50051";
  std::string map;
  bool json = false;
  double timeout_s = 30;
  client::Credentials credentials;
  std::string token_file;
  std::function<absl::Status()> run;  // the chosen command

  absl::StatusOr<std::unique_ptr<client::EsdfClient>> Connect() const;
  std::string MapName() const { return map.empty() ? "default" : map; }
};

// Each adds one command; its callback sets context.run.
void AddIngest(CLI::App& app, Context& context);
void AddQuery(CLI::App& app, Context& context);
void AddObjects(CLI::App& app, Context& context);
void AddInfo(CLI::App& app, Context& context);
void AddSlice(CLI::App& app, Context& context);
void AddMesh(CLI::App& app, Context& context);
void AddGrid(CLI::App& app, Context& context);
void AddHealth(CLI::App& app, Context& context);
void AddMap(CLI::App& app, Context& context);
void AddSnapshot(CLI::App& app, Context& context);
void AddTop(CLI::App& app, Context& context);
void AddDoctor(CLI::App& app, Context& context);
void AddDrain(CLI::App& app, Context& context);
void AddVersion(CLI::App& app, Context& context);

// A subcommand that sets context.run to `run`.
template <typename Run>
CLI::App* AddCommand(CLI::App& app, Context& context, const char* name, const char* help, Run run) {
  CLI::App* command = app.add_subcommand(name, help);
  command->callback([&context, run] { context.run = run; });
  return command;
}

// Writes bytes to a file. Errors name the path.
absl::Status WriteFile(const std::string& path, std::string_view bytes);

}  // namespace clearance::cli
