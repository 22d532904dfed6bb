// Options of the local Gaussian-process distance field.
#pragma once

#include "absl/status/status.h"

namespace clearance {

enum class KernelType { kSquaredExponential, kMatern32, kRationalQuadratic };

struct GpOptions {
  KernelType kernel = KernelType::kSquaredExponential;
  double length_scale_voxels = 1.0;   // l, in training spacings
  double noise_variance = 0.01;       // added to K_ii
  double max_latent_variance = 0.95;  // observations with larger v are not written

  absl::Status Validate() const;
};

}  // namespace clearance
