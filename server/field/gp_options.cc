#include "server/field/gp_options.h"

#include <cmath>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

absl::Status OutOfRange(const char* field, double got, const char* limit) {
  return absl::InvalidArgumentError(absl::StrFormat("%s is %g; it must be %s", field, got, limit));
}

}  // namespace

absl::Status GpOptions::Validate() const {
  // Beyond 4 spacings the kernel matrix of a neighbourhood is singular in float.
  if (!(length_scale_voxels >= 0.25 && length_scale_voxels <= 4.0)) {
    return OutOfRange("length_scale_voxels", length_scale_voxels, "in [0.25, 4]");
  }
  if (!(noise_variance >= 1e-5 && noise_variance <= 1.0)) {
    return OutOfRange("noise_variance", noise_variance, "in [1e-5, 1]");
  }
  if (!(max_latent_variance > 0.0 && max_latent_variance < 1.0)) {
    return OutOfRange("max_latent_variance", max_latent_variance, "in (0, 1)");
  }
  return absl::OkStatus();
}

}  // namespace clearance
