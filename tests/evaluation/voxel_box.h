// A dense box of voxels for truth and counts.
#pragma once

#include <cstdint>
#include <vector>

#include "server/map/voxel.h"

namespace clearance::evaluation {

template <typename T>
class VoxelBox {
 public:
  VoxelBox(const VoxelIndex& low, const VoxelIndex& high)
      : low_(low),
        size_(high - low + VoxelIndex::Ones()),
        values_(static_cast<size_t>(size_.x()) * size_.y() * size_.z()) {}

  const VoxelIndex& low() const { return low_; }
  size_t size() const { return values_.size(); }
  bool Contains(const VoxelIndex& v) const {
    const VoxelIndex d = v - low_;
    return (d.array() >= 0).all() && (d.array() < size_.array()).all();
  }
  size_t IndexOf(const VoxelIndex& v) const {
    const VoxelIndex d = v - low_;
    return (static_cast<size_t>(d.x()) * size_.y() + d.y()) * size_.z() + d.z();
  }
  VoxelIndex VoxelOfIndex(size_t i) const {
    const int z = static_cast<int>(i % size_.z()), y = static_cast<int>(i / size_.z() % size_.y());
    const int x = static_cast<int>(i / size_.z() / size_.y());
    return low_ + VoxelIndex(x, y, z);
  }
  T& operator[](size_t i) { return values_[i]; }
  const T& operator[](size_t i) const { return values_[i]; }
  T* Find(const VoxelIndex& v) { return Contains(v) ? &values_[IndexOf(v)] : nullptr; }
  const T* Find(const VoxelIndex& v) const { return Contains(v) ? &values_[IndexOf(v)] : nullptr; }

 private:
  VoxelIndex low_, size_;
  std::vector<T> values_;
};

}  // namespace clearance::evaluation
