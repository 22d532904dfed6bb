#include "server/query/point_query.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "server/query/point_answer.h"

namespace clearance {
namespace {

// Below this many points tasks give little: the other cores mostly map.
constexpr Eigen::Index kParallelPoints = 32768;
constexpr Eigen::Index kChunkPoints = 1024;

// The entries of the index that the selection lets count; empty = all.
std::vector<uint8_t> EnabledEntries(const ObjectIndex& index, const LayerSelection& layers) {
  if (layers.only_objects.empty() && layers.without_objects.empty()) return {};
  const auto contains = [](const std::vector<ObjectId>& ids, ObjectId id) {
    return std::find(ids.begin(), ids.end(), id) != ids.end();
  };
  std::vector<uint8_t> enabled;
  enabled.reserve(index.entries.size());
  for (const ObjectIndex::Entry& entry : index.entries) {
    const bool wanted = layers.only_objects.empty() || contains(layers.only_objects, entry.id);
    enabled.push_back(wanted && !contains(layers.without_objects, entry.id));
  }
  return enabled;
}

void Allocate(Eigen::Index points, const QueryOptions& options, DistanceBatch* batch) {
  const size_t n = static_cast<size_t>(points);
  batch->distances_m.resize(n);
  batch->states.resize(n);
  if (options.gradients) batch->gradients_W.resize(3, points);
  if (options.objects) batch->object_ids.resize(n);
  if (options.sigmas) batch->sigmas_m.resize(n);
  if (options.unknown_distances) batch->unknown_distances_m.resize(n);
}

std::vector<uint32_t> NamedObjects(const ObjectIndex& index, const std::vector<uint32_t>& ids) {
  std::vector<bool> named(1 << 16, false);
  for (uint32_t id : ids) named[id] = true;
  std::vector<uint32_t> indices;
  for (const ObjectIndex::Entry& entry : index.entries) {
    if (named[entry.id.value()]) indices.push_back(entry.object);
  }
  std::sort(indices.begin(), indices.end());
  return indices;
}

}  // namespace

DistanceBatch QueryDistances(const MapView& view, const Eigen::Matrix3Xd& points_W,
                             const QueryOptions& options) {
  std::shared_ptr<const ObjectIndex> index = view.object_index;
  if (index == nullptr) index = BuildObjectIndex(view.objects);
  const std::vector<uint8_t> enabled = EnabledEntries(*index, options.layers);
  DistanceBatch batch;
  const Eigen::Index n = points_W.cols();
  Allocate(n, options, &batch);
  const auto answer = [&](Eigen::Index begin, Eigen::Index end) {
    PointAnswerer(view, *index, enabled, options).Answer(points_W, begin, end, &batch);
  };
  if (options.parallel && n >= kParallelPoints) {
    tbb::parallel_for(
        tbb::blocked_range<Eigen::Index>(0, n, kChunkPoints),
        [&](const tbb::blocked_range<Eigen::Index>& range) { answer(range.begin(), range.end()); });
  } else {
    answer(0, n);
  }
  if (options.objects) batch.object_indices = NamedObjects(*index, batch.object_ids);
  return batch;
}

}  // namespace clearance
