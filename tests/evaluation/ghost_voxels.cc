// Fuses a sequence folder and lists the ghosts among the voxels to be judged, with their history:
//   ghost_voxels FOLDER VOXELS.csv [--frames N] [--trace N] [--out GHOSTS.csv]
// VOXELS.csv holds their centres (x,y,z in W, no header), as ghosts.py writes them.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "server/integration/frame_integrator.h"
#include "server/integration/stored_surface.h"
#include "server/map/world_map.h"
#include "tests/evaluation/state_box.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::evaluation {
namespace {

struct Less {
  bool operator()(const VoxelIndex& a, const VoxelIndex& b) const {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  }
};
using VoxelSet = std::set<VoxelIndex, Less>;

VoxelSet ReadVoxels(const std::string& path, double h) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path + ": cannot be read");
  VoxelSet voxels;
  double x, y, z;
  char comma;
  while (in >> x >> comma >> y >> comma >> z) voxels.insert(VoxelOf({x, y, z}, h));
  return voxels;
}

WorldMap EmptyMap(const testing::SequenceFolder& sequence) {
  MapConfig config;
  config.voxel_size_m = sequence.voxel_size_m;
  config.max_range_m = sequence.max_range_m;
  return WorldMap(config);
}

template <typename Visit>
void Fuse(const testing::SequenceFolder& sequence, int frames, WorldMap& map, const Visit& visit) {
  const FrameIntegrator integrator(IntegratorOptions::For(map.config()));
  for (int k = 0; k < frames; ++k) {
    auto update = integrator.Integrate(ReadFrame(sequence, k), map);
    if (!update.ok()) throw std::runtime_error(std::string(update.status().message()));
    visit(k, *update);
    map.Apply(*update);
  }
}

// What a frame is about to do to a voxel; empty where it only adds to free space.
std::string Trace(int k, const SurfaceUpdate& update, const SurfaceMap& map, const VoxelIndex& v) {
  const BlockIndex block = BlockOf(v);
  const int o = OffsetOf(v);
  std::string what;
  char text[160];
  for (const auto& b : update.band.blocks) {
    if (b.block != block) continue;
    for (uint32_t i = b.begin; i < b.end; ++i) {
      if (update.band.offset[i] != o) continue;
      std::snprintf(text, sizeof text, " band %.3f w %.2f", update.band.distance_m[i],
                    update.band.weight[i]);
      what += text;
    }
  }
  for (const FreeBlock& f : update.free) {
    if (f.block != block) continue;
    if (Test(f.confident, o))
      what += " confident";
    else if (Test(f.probable, o))
      what += " probable";
    if (Test(f.contradicted, o)) what += " contradicted";
    if (Test(f.refuted, o)) what += " refuted";
    if (Test(f.hit, o)) what += " hit";
  }
  for (const ReleasedBlock& r : update.released) {
    if (r.block == block && Test(r.voxels, o)) what += " released";
  }
  const float* weight = map.WeightBlock(block);
  const bool stored = weight && weight[o] > 0;
  if (what.empty() || (!stored && (what == " probable" || what == " confident"))) return "";
  if (stored) {
    const float mean = map.MeanBlock(block)[o];
    const Eigen::Vector3f n = StoredSurface(map, block).Normal(o);
    const FreeEvidence e = map.EvidenceAt(v);
    const FreeEvidence site =
        map.EvidenceAt(v + SurfaceStep(mean / static_cast<float>(map.voxel_size_m()), n));
    std::snprintf(text, sizeof text, " | mean %.3f w %.2f n %.2f %.2f %.2f votes %d returns %d",
                  mean, weight[o], n.x(), n.y(), n.z(), e.contradicted, site.returns);
    what += text;
  }
  return "    frame " + std::to_string(k) + ":" + what + "\n";
}

void Run(const std::string& folder, const std::string& voxels, int frames, size_t traced,
         const std::string& out_path) {
  const testing::SequenceFolder sequence = testing::OpenSequence(folder);
  frames = std::min(frames, sequence.size());
  const double h = sequence.voxel_size_m;
  const VoxelSet judged = ReadVoxels(voxels, h);
  WorldMap map = EmptyMap(sequence);
  Fuse(sequence, frames, map, [](int, const MapUpdate&) {});
  std::vector<VoxelIndex> ghosts;
  int count[3] = {};
  // Blockwise: composing states costs the same for a block as for a voxel.
  std::map<BlockIndex, std::vector<VoxelIndex>> by_block;
  for (const VoxelIndex& v : judged) by_block[BlockOf(v)].push_back(v);
  for (const auto& [block, members] : by_block) {
    VoxelBox<StateOfVoxel> box(VoxelAt(block, 0), VoxelAt(block, kBlockVoxels - 1));
    ComposeStates(map.static_map(), map.fusion(), box);
    for (const VoxelIndex& v : members) {
      const Known known = box.Find(v)->known;
      ++count[static_cast<int>(known)];
      if (known == Known::kOccupied) ghosts.push_back(v);
    }
  }
  std::printf("judged %zu voxels: %d free, %d unknown, %d ghosts\n", judged.size(), count[1],
              count[0], count[2]);
  if (!out_path.empty()) {
    std::ofstream out(out_path);
    for (const VoxelIndex& v : ghosts) {
      const Eigen::Vector3d c = VoxelCentre(v, h);
      const BlockIndex b = BlockOf(v);
      const FreeEvidence e = map.static_map().EvidenceAt(v);
      const float* mean = map.static_map().MeanBlock(b);
      const float* weight = map.static_map().WeightBlock(b);
      const Eigen::Vector3f n = StoredSurface(map.static_map(), b).Normal(OffsetOf(v));
      out << c.x() << ',' << c.y() << ',' << c.z() << ',' << (mean ? mean[OffsetOf(v)] : 0) << ','
          << (weight ? weight[OffsetOf(v)] : 0) << ',' << int{e.confident} << ',' << int{e.probable}
          << ',' << int{e.contradicted} << ',' << int{e.returns} << ',' << n.norm() << '\n';
    }
  }
  if (traced == 0 || ghosts.empty()) return;
  std::vector<VoxelIndex> picked;
  for (size_t i = 0; i < std::min(traced, ghosts.size()); ++i) {
    picked.push_back(ghosts[i * ghosts.size() / std::min(traced, ghosts.size())]);
  }
  std::vector<std::string> stories(picked.size());
  WorldMap again = EmptyMap(sequence);
  Fuse(sequence, frames, again, [&](int k, const MapUpdate& update) {
    for (size_t i = 0; i < picked.size(); ++i) {
      stories[i] += Trace(k, update.static_surface, again.static_map(), picked[i]);
    }
  });
  for (size_t i = 0; i < picked.size(); ++i) {
    const Eigen::Vector3d c = VoxelCentre(picked[i], h);
    std::printf("  ghost at %.2f %.2f %.2f\n%s", c.x(), c.y(), c.z(), stories[i].c_str());
  }
}

}  // namespace
}  // namespace clearance::evaluation

int main(int argc, char** argv) {
  CLI::App app{"Ghosts of a sequence, with their history"};
  std::string folder, voxels, out;
  int frames = 1 << 30;
  size_t traced = 0;
  app.add_option("folder", folder)->required();
  app.add_option("voxels", voxels)->required();
  app.add_option("--frames", frames);
  app.add_option("--trace", traced, "ghosts whose history is printed");
  app.add_option("--out", out, "ghosts as CSV");
  CLI11_PARSE(app, argc, argv);
  try {
    clearance::evaluation::Run(folder, voxels, frames, traced, out);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
