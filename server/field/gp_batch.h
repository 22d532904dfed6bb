// Eight small Gaussian-process distance fields solved side by side; the live path's form of
// LocalGpField for the squared-exponential kernel.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "server/field/lanes.h"

namespace clearance {

// A view of up to eight fields of at most n points each, over storage of Size(n) that the caller
// owns. Fill every lane's points with SetPoint (a lane's unused slots with Pad), then Train.
// Results of a lane do not depend on what is in the others, nor on n. Not thread-safe while being
// trained.
class GpBatch {
 public:
  static constexpr int kMaxPoints = 27;

  static constexpr size_t Size(int n) { return static_cast<size_t>(n) * 5 + n * (n + 1) / 2; }
  GpBatch(Lanes* storage, int n) : data_(storage), n_(n) {}

  int size() const { return n_; }

  // Point i of a lane, metres from that lane's own origin; `noise_variance` is added to K_ii.
  void SetPoint(int i, int lane, const Eigen::Vector3f& p, float noise_variance) {
    x(i)[lane] = p.x();
    y(i)[lane] = p.y();
    z(i)[lane] = p.z();
    alpha(i)[lane] = noise_variance;  // becomes alpha when trained
    target(i)[lane] = 1.f;
  }
  void Pad(int i, int lane);

  // length_m: l of k(r) = exp(-r^2 / (2 l^2)).
  void Train(float length_m);

  // Of every lane: sum(w_j x_j) / sum(w_j), w_j = alpha_j k(x, x_j), at one point x per lane (see
  // GpSample::foot).
  void Foot(const Lanes x[3], float length_m, Lanes foot[3]) const;

  // One lane's field at eight points (columns of three Lanes), with positions moved by
  // shift[i] in the foot's mean. `count`: points of that lane.
  struct Samples {
    Lanes latent, variance;
    std::array<Lanes, 3> foot;
  };
  Samples Evaluate(int lane, int count, const Eigen::Vector3f* shift, float length_m,
                   const std::array<Lanes, 3>& x) const;

  Eigen::Vector3f point(int i, int lane) const { return {x(i)[lane], y(i)[lane], z(i)[lane]}; }

 private:
  Lanes& x(int i) const { return data_[i]; }
  Lanes& y(int i) const { return data_[n_ + i]; }
  Lanes& z(int i) const { return data_[2 * n_ + i]; }
  Lanes& alpha(int i) const { return data_[3 * n_ + i]; }
  Lanes& target(int i) const { return data_[4 * n_ + i]; }
  // Packed lower triangle; the diagonal holds 1 / L_ii.
  Lanes& L(int i, int j) const { return data_[5 * n_ + i * (i + 1) / 2 + j]; }

  Lanes* data_;
  int n_;
};

}  // namespace clearance
