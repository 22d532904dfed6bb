// Plain values as bytes and back: what snapshots and log records are made of.
#pragma once

#include <Eigen/Core>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "server/core/pose.h"

namespace clearance {

static_assert(std::endian::native == std::endian::little,
              "files are little-endian and are read and written without swapping");

template <typename T>
concept PlainValue = std::is_trivially_copyable_v<T> && !std::is_pointer_v<T>;

class ByteWriter {
 public:
  template <PlainValue T>
  void Put(const T& value) {
    PutRaw(&value, sizeof(T));
  }
  void PutRaw(const void* data, size_t bytes) {
    bytes_.append(static_cast<const char*>(data), bytes);
  }
  // With its length.
  void PutText(std::string_view text) {
    Put<uint64_t>(text.size());
    PutRaw(text.data(), text.size());
  }
  template <PlainValue T>
  void PutVector(const std::vector<T>& values) {
    Put<uint64_t>(values.size());
    PutRaw(values.data(), values.size() * sizeof(T));
  }
  // Coefficients in storage order, exactly; fixed sizes only.
  template <typename Derived>
  void PutMatrix(const Eigen::PlainObjectBase<Derived>& m) {
    static_assert(Derived::SizeAtCompileTime != Eigen::Dynamic);
    PutRaw(m.data(), sizeof(typename Derived::Scalar) * Derived::SizeAtCompileTime);
  }
  void PutPose(const Pose& pose) { PutMatrix(pose.matrix()); }

  size_t size() const { return bytes_.size(); }
  std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

// Reads in the order of writing. A short input gives zeros from there on and Finish() says so: the
// caller checks once, at the end, and before it trusts a number as an index.
class ByteReader {
 public:
  // `name` is how errors call the input.
  ByteReader(std::string_view bytes, std::string name) : rest_(bytes), name_(std::move(name)) {}

  template <PlainValue T>
  T Get() {
    T value{};
    GetRaw(&value, sizeof(T));
    return value;
  }
  void GetRaw(void* out, size_t bytes) {
    if (bytes > rest_.size()) {
      ok_ = false;
      rest_ = {};
      return;
    }
    if (bytes > 0) std::memcpy(out, rest_.data(), bytes);
    rest_.remove_prefix(bytes);
  }
  std::string_view GetText() {
    const size_t size = GetCount(1);
    const std::string_view text = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return text;
  }
  template <PlainValue T>
  std::vector<T> GetVector() {
    std::vector<T> values(GetCount(sizeof(T)));
    GetRaw(values.data(), values.size() * sizeof(T));
    return values;
  }
  // A number of things that take at least `bytes_each`: never more than the input can hold.
  size_t GetCount(size_t bytes_each) {
    const uint64_t count = Get<uint64_t>();
    if (count <= rest_.size() / bytes_each) return count;
    ok_ = false;
    rest_ = {};
    return 0;
  }
  template <typename Derived>
  void GetMatrix(Eigen::PlainObjectBase<Derived>& m) {
    static_assert(Derived::SizeAtCompileTime != Eigen::Dynamic);
    GetRaw(m.data(), sizeof(typename Derived::Scalar) * Derived::SizeAtCompileTime);
  }
  Pose GetPose() {
    Pose pose = Pose::Identity();
    GetMatrix(pose.matrix());
    return pose;
  }

  bool ok() const { return ok_; }
  std::string_view rest() const { return rest_; }
  absl::Status Error(const std::string& what) const {
    return absl::DataLossError(absl::StrCat(name_, ": ", what));
  }
  // DATA_LOSS where the input was too short or holds more than was read.
  absl::Status Finish() const {
    if (!ok_) return Error("ends too early");
    if (!rest_.empty()) return Error(absl::StrCat(rest_.size(), " bytes too many"));
    return absl::OkStatus();
  }

 private:
  std::string_view rest_;
  std::string name_;
  bool ok_ = true;
};

}  // namespace clearance
