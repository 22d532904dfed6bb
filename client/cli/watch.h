// The `watch` command.
#pragma once

#include "client/cli/context.h"

namespace clearance::cli {

void AddWatch(CLI::App& app, Context& context);

}  // namespace clearance::cli
