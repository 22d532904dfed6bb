// The server's log: lines of text, or one JSON object a line, on stderr.
#pragma once

#include <spdlog/common.h>

#include <nlohmann/json_fwd.hpp>
#include <string_view>

namespace clearance {

enum class LogFormat { kText, kJson };

// For every spdlog call of the process; call before threads that log begin. `sink`: instead of
// stderr.
void SetUpLog(LogFormat format, spdlog::sink_ptr sink = nullptr);

// An event with fields: members beside time, level and message in JSON, key=value in text. Thread-
// safe.
void Log(spdlog::level::level_enum level, std::string_view message,
         const nlohmann::ordered_json& fields);

}  // namespace clearance
