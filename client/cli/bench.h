// The command `bench`.
#pragma once

#include "client/cli/context.h"

namespace clearance::cli {

void AddBench(CLI::App& app, Context& context);

}  // namespace clearance::cli
