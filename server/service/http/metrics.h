// The server's state in Prometheus' text format.
#pragma once

#include <string>

#include "server/service/service_context.h"

namespace clearance {

std::string MetricsText(const ServiceContext& service);

}  // namespace clearance
