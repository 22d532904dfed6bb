#include "server/field/gp_batch.h"

namespace clearance {

void GpBatch::Pad(int i, int lane) {
  // Far from everything, each at its own place, with target 0: row i of K is a unit row and alpha
  // 0.
  x(i)[lane] = y(i)[lane] = z(i)[lane] = 1e6f * static_cast<float>(i + 1);
  alpha(i)[lane] = 0.f;
  target(i)[lane] = 0.f;
}

void GpBatch::Train(float length_m) {
  const float scale = -0.5f / (length_m * length_m);
  for (int i = 0; i < n_; ++i) {  // Cholesky, row by row
    for (int j = 0; j < i; ++j) {
      const Lanes dx = x(i) - x(j), dy = y(i) - y(j), dz = z(i) - z(j);
      Lanes s = ExpOfNegative((dx * dx + dy * dy + dz * dz) * scale);
      for (int k = 0; k < j; ++k) s -= L(i, k) * L(j, k);
      L(i, j) = s * L(j, j);
    }
    Lanes s = 1.f + alpha(i);
    for (int k = 0; k < i; ++k) s -= L(i, k) * L(i, k);
    L(i, i) = 1.f / Sqrt(Max(s, Splat(1e-6f)));
  }
  for (int i = 0; i < n_; ++i) {  // forward
    Lanes s = target(i);
    for (int k = 0; k < i; ++k) s -= L(i, k) * alpha(k);
    alpha(i) = s * L(i, i);
  }
  for (int i = n_ - 1; i >= 0; --i) {  // backward
    Lanes s = alpha(i);
    for (int k = i + 1; k < n_; ++k) s -= L(k, i) * alpha(k);
    alpha(i) = s * L(i, i);
  }
}

void GpBatch::Foot(const Lanes at[3], float length_m, Lanes foot[3]) const {
  const float scale = -0.5f / (length_m * length_m);
  Lanes sum{}, fx{}, fy{}, fz{};
  for (int i = 0; i < n_; ++i) {
    const Lanes dx = at[0] - x(i), dy = at[1] - y(i), dz = at[2] - z(i);
    const Lanes w = alpha(i) * ExpOfNegative((dx * dx + dy * dy + dz * dz) * scale);
    sum += w;
    fx += w * dx;  // relative to `at`: padded points are far and must not enter but by w = 0
    fy += w * dy;
    fz += w * dz;
  }
  foot[0] = at[0] - fx / sum;
  foot[1] = at[1] - fy / sum;
  foot[2] = at[2] - fz / sum;
}

GpBatch::Samples GpBatch::Evaluate(int lane, int count, const Eigen::Vector3f* shift,
                                   float length_m, const std::array<Lanes, 3>& at) const {
  const float scale = -0.5f / (length_m * length_m);
  Lanes latent{}, explained{}, fx{}, fy{}, fz{};
  Lanes solved[kMaxPoints];
  for (int i = 0; i < count; ++i) {
    const float px = x(i)[lane], py = y(i)[lane], pz = z(i)[lane];
    const Lanes dx = at[0] - px, dy = at[1] - py, dz = at[2] - pz;
    const Lanes k = ExpOfNegative((dx * dx + dy * dy + dz * dz) * scale);
    Lanes s = k;
    const Lanes* row = &L(i, 0);
    for (int j = 0; j < i; ++j) s -= row[j][lane] * solved[j];
    solved[i] = s * row[i][lane];
    explained += solved[i] * solved[i];
    const Lanes w = alpha(i)[lane] * k;
    latent += w;
    fx += w * (px + shift[i].x());
    fy += w * (py + shift[i].y());
    fz += w * (pz + shift[i].z());
  }
  Samples out;
  out.latent = latent;
  out.variance = Max(1.f - explained, Splat(0.f));
  out.foot = {fx / latent, fy / latent, fz / latent};
  return out;
}

}  // namespace clearance
