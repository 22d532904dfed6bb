#include "server/service/log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/time/time.h"

namespace clearance {
namespace {

using Json = nlohmann::ordered_json;

// Of the logger whose messages are members of an object already.
constexpr char kMembers[] = "members";

std::atomic<bool> json_lines = false;

std::string Dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string_view View(spdlog::string_view_t text) { return {text.data(), text.size()}; }

class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& out) override {
    const std::string time = absl::FormatTime("%Y-%m-%d%ET%H:%M:%E6SZ",
                                              absl::FromChrono(message.time), absl::UTCTimeZone());
    std::string line = R"({"time":")" + time + R"(","level":")";
    line += View(spdlog::level::to_string_view(message.level));
    line += "\",";
    if (View(message.logger_name) == kMembers) {
      line += View(message.payload);
    } else {
      line += R"("message":)" + Dump(std::string(View(message.payload)));
    }
    line += "}\n";
    out.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<JsonFormatter>();
  }
};

}  // namespace

void SetUpLog(LogFormat format, spdlog::sink_ptr sink) {
  if (!sink) sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
  json_lines = format == LogFormat::kJson;
  if (json_lines) {
    sink->set_formatter(std::make_unique<JsonFormatter>());
  } else {
    sink->set_formatter(std::make_unique<spdlog::pattern_formatter>(
        "%Y-%m-%dT%H:%M:%S.%eZ %l %v", spdlog::pattern_time_type::utc));
  }
  spdlog::drop(kMembers);
  auto members = std::make_shared<spdlog::logger>(kMembers, sink);
  auto plain = std::make_shared<spdlog::logger>("", sink);
  for (const auto& logger : {members, plain}) logger->flush_on(spdlog::level::info);
  spdlog::register_logger(members);
  spdlog::set_default_logger(plain);
}

void Log(spdlog::level::level_enum level, std::string_view message, const Json& fields) {
  const std::shared_ptr<spdlog::logger> members = spdlog::get(kMembers);
  if (json_lines && members) {
    Json all = {{"message", message}};
    all.update(fields);
    const std::string object = Dump(all);
    members->log(level, object.substr(1, object.size() - 2));
    return;
  }
  std::string line(message);
  for (const auto& [key, value] : fields.items()) {
    line += " " + key + "=" + (value.is_string() ? value.get<std::string>() : Dump(value));
  }
  spdlog::log(level, line);
}

}  // namespace clearance
