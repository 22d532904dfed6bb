// The command `bench watch`.
#pragma once

#include "client/cli/context.h"

namespace clearance::cli {

void AddBenchWatch(CLI::App& bench, Context& context);

}  // namespace clearance::cli
