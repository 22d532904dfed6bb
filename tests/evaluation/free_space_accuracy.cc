// Free space and ghosts of a sequence folder:
//   free_space_accuracy FOLDER [--frames N] [--shrink-labels PX] [--late-labels N]
//                       [--keep-contradicted] [--no-contradiction] [--states FILE.csv]
// Fuses the frames and prints
// - ghosts: voxels that an object swept and left, at least a voxel from any truly static surface
// and
//   with three or more rays through them since: how many are not free;
// - truly occupied voxels (the cube contains static surface) that were observed, by state;
// - the time of ObserveFreeSpace;
// and writes the states around the sensor's height for comparison with gt/free_space.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/integration/frame_integrator.h"
#include "server/integration/stored_surface.h"
#include "server/map/world_map.h"
#include "tests/evaluation/label_damage.h"
#include "tests/evaluation/state_box.h"
#include "tests/evaluation/surface_truth.h"
#include "tests/testing/ray_walk.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::evaluation {
namespace {

struct Arguments {
  std::filesystem::path folder;
  int frames = 1 << 30, shrink = 0, late = 0;
  bool contradiction = true, list = false;
  std::string states;
};

Arguments Parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string arg = argv[i];
    const auto value = [&] {
      if (++i == argc) throw std::runtime_error(arg + " needs a value");
      return std::string(argv[i]);
    };
    if (arg == "--frames") {
      a.frames = std::stoi(value());
    } else if (arg == "--shrink-labels") {
      a.shrink = std::stoi(value());
    } else if (arg == "--late-labels") {
      a.late = std::stoi(value());
    } else if (arg == "--no-contradiction") {
      a.contradiction = false;
    } else if (arg == "--list") {
      a.list = true;
    } else if (arg == "--states") {
      a.states = value();
    } else {
      a.folder = arg;
    }
  }
  if (a.folder.empty()) throw std::runtime_error("usage: free_space_accuracy FOLDER [options]");
  return a;
}

// What the true labels say about each voxel.
struct Truth {
  uint8_t surface = 0;      // surface_truth's bits
  uint8_t static_hits = 0;  // static returns in the cube
  uint8_t rays = 0;         // through the cube since an object left it, saturating
  int16_t last_swept = -1;  // the last frame in which an object's return lay in the cube
};

uint8_t Plus1(uint8_t n) { return n < 255 ? n + 1 : n; }

VoxelBox<Truth> MakeBox(const testing::SequenceFolder& sequence, int frames, double h) {
  Eigen::AlignedBox3d bounds;
  for (int k = 0; k < frames; k += std::max(1, frames / 20)) {
    const Frame frame = ReadFrame(sequence, k);
    testing::ForEachReturn(frame, [&](const Eigen::Vector3d& p_X, uint16_t) {
      if (p_X.norm() <= sequence.max_range_m) bounds.extend(frame.T_W_X * p_X);
    });
  }
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(8 * h);
  return {VoxelOf(bounds.min() - margin, h), VoxelOf(bounds.max() + margin, h)};
}

// A mover's box in one frame; boxes sweep the insides of objects, which no return marks.
struct BoxInFrame {
  int frame;
  Pose T_W_B = Pose::Identity();
  Eigen::AlignedBox3d box;
};

std::vector<BoxInFrame> ReadBoxes(const testing::SequenceFolder& sequence) {
  const bool simulated = std::filesystem::exists(sequence.path / "gt/object_poses.csv");
  std::ifstream in(sequence.path / (simulated ? "gt/object_poses.csv" : "object_poses.csv"));
  std::map<int, Eigen::AlignedBox3d> shapes;
  std::vector<BoxInFrame> boxes;
  std::string line;
  for (std::getline(in, line); std::getline(in, line);) {
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    if (!simulated) cells.erase(cells.begin() + 2);  // the class
    const auto number = [&](int i) { return std::stod(cells.at(i)); };
    BoxInFrame b;
    b.frame = std::stoi(cells[0]);
    const int id = std::stoi(cells[1]);
    b.T_W_B = Eigen::Translation3d(number(2), number(3), number(4)) *
              Eigen::Quaterniond(number(8), number(5), number(6), number(7)).normalized();
    if (simulated) {
      Eigen::AlignedBox3d& shape = shapes[id];
      if (shape.isEmpty()) {
        const auto path = sequence.path / "gt/objects" / (std::to_string(id) + ".ply");
        for (const Eigen::Vector3d& p : testing::ReadMesh(path).vertices) shape.extend(p);
      }
      b.box = shape;
    } else {
      const Eigen::Vector3d half = Eigen::Vector3d(number(9), number(10), number(11)) / 2;
      b.box = Eigen::AlignedBox3d(-half, half);
    }
    boxes.push_back(b);
  }
  return boxes;
}

void MarkSwept(const BoxInFrame& b, double h, VoxelBox<Truth>& box) {
  Eigen::AlignedBox3d reach;
  for (int i = 0; i < 8; ++i) {
    reach.extend(b.T_W_B * b.box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(i)));
  }
  const VoxelIndex low = VoxelOf(reach.min(), h), high = VoxelOf(reach.max(), h);
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        Truth* t = box.Find({x, y, z});
        if (t && b.box.contains(b.T_W_B.inverse() * VoxelCentre({x, y, z}, h))) {
          t->last_swept = std::max(t->last_swept, static_cast<int16_t>(b.frame));
        }
      }
    }
  }
}

// Marks what objects swept, then counts the rays that went through it afterwards.
void MeasureTruth(const testing::SequenceFolder& sequence, int frames, double h,
                  VoxelBox<Truth>& box) {
  const std::vector<BoxInFrame> boxes = ReadBoxes(sequence);
  for (const BoxInFrame& b : boxes) {
    if (b.frame < frames) MarkSwept(b, h, box);
  }
  for (int k = 0; k < frames; ++k) {
    const Frame frame = ReadFrame(sequence, k);
    std::vector<BoxInFrame> now;
    std::copy_if(boxes.begin(), boxes.end(), std::back_inserter(now),
                 [&](const BoxInFrame& b) { return b.frame == k; });
    testing::ForEachReturn(frame, [&](const Eigen::Vector3d& p_X, uint16_t label) {
      if (p_X.norm() > sequence.max_range_m) return;
      const Eigen::Vector3d p_W = frame.T_W_X * p_X;
      Truth* t = box.Find(VoxelOf(p_W, h));
      if (!t) return;
      if (label != 0) {
        t->last_swept = std::max(t->last_swept, static_cast<int16_t>(k));
        return;
      }
      // A recording's labels are rough: near a mover's box nothing is surely static.
      const bool surely = std::none_of(now.begin(), now.end(), [&](const BoxInFrame& b) {
        return b.box.exteriorDistance(b.T_W_B.inverse() * p_W) < 0.5;
      });
      if (surely) t->static_hits = Plus1(t->static_hits);
    });
  }
  // Left only once the neighbours are left, too: bodies move between frames.
  VoxelBox<int16_t> last(box.low(), box.VoxelOfIndex(box.size() - 1));
  for (size_t i = 0; i < box.size(); ++i) {
    if (box[i].last_swept < 0) continue;
    const VoxelIndex v = box.VoxelOfIndex(i);
    for (int n = 0; n < 27; ++n) {
      int16_t* l = last.Find(v + VoxelIndex(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1));
      if (l) *l = std::max(*l, box[i].last_swept);
    }
  }
  for (size_t i = 0; i < box.size(); ++i) {
    if (box[i].last_swept >= 0) box[i].last_swept = last[i];
  }
  for (int k = 1; k < frames; ++k) {
    const Frame frame = ReadFrame(sequence, k);
    const Eigen::Vector3d eye = frame.T_W_X.translation();
    testing::ForEachReturn(frame, [&](const Eigen::Vector3d& p_X, uint16_t) {
      const double range = p_X.norm();
      const Eigen::Vector3d end =
          frame.T_W_X * Eigen::Vector3d(p_X * std::min(1.0, sequence.max_range_m / range));
      testing::WalkRay(eye, end, h, [&](const VoxelIndex& v, double, double) {
        Truth* t = box.Find(v);
        if (t && t->last_swept >= 0 && k > t->last_swept) t->rays = Plus1(t->rays);
      });
    });
  }
}

// Without a mesh, truly static surface is where static returns lie that no mover can have caused.
void MarkNearReturns(VoxelBox<Truth>& box) {
  for (size_t i = 0; i < box.size(); ++i) {
    if (box[i].static_hits == 0) continue;
    box[i].surface |= kContainsSurface;
    const VoxelIndex v = box.VoxelOfIndex(i);
    for (int n = 0; n < 27; ++n) {
      Truth* t = box.Find(v + VoxelIndex(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1));
      if (t) t->surface |= kNearSurface;
    }
  }
}

struct Rates {
  int ghosts[3] = {}, phantoms = 0;
  int observed[3] = {};       // truly occupied with static returns, by state
  int well_observed[3] = {};  // the same, five returns and more
  int seen_low = 0, seen_high = 0, truly_occupied = 0;
};

// Milliseconds of ObserveFreeSpace alone, of processor time of all threads: wall time says little
// on a machine that does other things.
double TimeOf(const Frame& frame, const testing::SequenceFolder& sequence, double h,
              const WorldMap& map) {
  const RangeImage image =
      sequence.lidar
          ? RangeImage::FromCloud(std::get<PointCloud>(frame.observation),
                                  0.5 * h / sequence.max_range_m, sequence.max_range_m)
          : RangeImage::FromDepth(std::get<DepthImage>(frame.observation), sequence.max_range_m);
  std::vector<Eigen::Vector3f> points;
  testing::ForEachReturn(frame, [&](const Eigen::Vector3d& p_X, uint16_t label) {
    if (label == 0 && p_X.norm() <= sequence.max_range_m) points.push_back(p_X.cast<float>());
  });
  Eigen::Matrix3Xf points_X(3, points.size());
  std::vector<uint32_t> all(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    points_X.col(static_cast<Eigen::Index>(i)) = points[i];
    all[i] = static_cast<uint32_t>(i);
  }
  const LocalVoxels static_voxels = GatherVoxels(points_X, all, frame.T_W_X, h);
  const FreeSpaceOptions options{h, sequence.max_range_m};
  const std::clock_t start = std::clock();
  const auto free = ObserveFreeSpace(image, frame.T_W_X, static_voxels, map.static_map(), options);
  const std::clock_t end = std::clock();
  return free.empty() ? 0 : 1e3 * static_cast<double>(end - start) / CLOCKS_PER_SEC;
}

void Run(const Arguments& arguments) {
  const testing::SequenceFolder sequence = testing::OpenSequence(arguments.folder);
  const int frames = std::min(arguments.frames, sequence.size());
  MapConfig config;
  config.voxel_size_m = sequence.voxel_size_m;
  config.max_range_m = sequence.max_range_m;
  const double h = config.voxel_size_m;
  WorldMap map(config);
  const FrameIntegrator integrator(IntegratorOptions::For(config));
  LateLabels late(arguments.late);
  std::vector<double> times_ms;
  for (int k = 0; k < frames; ++k) {
    Frame frame = ReadFrame(sequence, k);
    if (arguments.late > 0) late.Apply(frame);
    if (arguments.shrink > 0) ShrinkLabels(arguments.shrink, frame);
    auto update = integrator.Integrate(frame, map);
    if (!update.ok()) throw std::runtime_error(std::string(update.status().message()));
    times_ms.push_back(TimeOf(frame, sequence, h, map));
    if (!arguments.contradiction) {
      for (FreeBlock& f : update->static_surface.free) f.contradicted = {};
    }
    map.Apply(*update);
  }
  std::sort(times_ms.begin(), times_ms.end());
  std::printf("ObserveFreeSpace: processor time median %.2f ms, p95 %.2f ms\n",
              times_ms[times_ms.size() / 2], times_ms[times_ms.size() * 95 / 100]);

  VoxelBox<Truth> truth = MakeBox(sequence, frames, h);
  const VoxelIndex low = truth.low(), high = truth.VoxelOfIndex(truth.size() - 1);
  MeasureTruth(sequence, frames, h, truth);
  if (std::filesystem::exists(sequence.path / "gt/static.ply")) {
    VoxelBox<uint8_t> marks(low, high);
    MarkSurface(testing::ReadMesh(sequence.path / "gt/static.ply"), h, marks);
    for (size_t i = 0; i < marks.size(); ++i) truth[i].surface = marks[i];
  } else {
    MarkNearReturns(truth);
  }
  VoxelBox<StateOfVoxel> states(low, high);
  ComposeStates(map.static_map(), map.fusion(), states);

  Rates r;
  for (size_t i = 0; i < truth.size(); ++i) {
    const Truth& t = truth[i];
    const StateOfVoxel& s = states[i];
    const bool far = !(t.surface & kNearSurface);
    if (t.last_swept >= 0 && far && t.rays >= 3) {
      ++r.ghosts[static_cast<int>(s.known)];
      if (arguments.list && s.known == Known::kOccupied) {
        const VoxelIndex v = truth.VoxelOfIndex(i);
        const Eigen::Vector3d c = VoxelCentre(v, h);
        const BlockIndex b = BlockOf(v);
        const float* mean = map.static_map().MeanBlock(b);
        const float* weight = map.static_map().WeightBlock(b);
        std::vector<int32_t> evidence(kHaloVoxels);
        map.static_map().ReadEvidence(b, evidence.data());
        const int o = OffsetOf(v);
        const auto e = FreeEvidence::Unpack(evidence[HaloOffset(o >> 6, (o >> 3) & 7, o & 7)]);
        const Eigen::Vector3f n = StoredSurface(map.static_map(), b).Normal(o);
        std::printf("  normal %.2f %.2f %.2f\n", n.x(), n.y(), n.z());
        std::printf(
            "  ghost at %.2f %.2f %.2f: last swept %d, rays %d, mean %.3f weight %.2f, confident "
            "%d probable %d contradicted %d\n",
            c.x(), c.y(), c.z(), t.last_swept, t.rays, mean ? mean[OffsetOf(v)] : 9.f,
            weight ? weight[OffsetOf(v)] : 0.f, e.confident, e.probable, e.contradicted);
      }
    }
    if (far && s.known == Known::kOccupied) ++r.phantoms;
    if (!(t.surface & kContainsSurface)) continue;
    ++r.truly_occupied;
    if (s.known == Known::kFree) ++(s.confident ? r.seen_high : r.seen_low);
    if (t.static_hits > 0) ++r.observed[static_cast<int>(s.known)];
    if (t.static_hits >= 5) ++r.well_observed[static_cast<int>(s.known)];
    if (arguments.list && t.static_hits > 0 && s.known != Known::kOccupied) {
      const VoxelIndex v = truth.VoxelOfIndex(i);
      const float* mean = map.static_map().MeanBlock(BlockOf(v));
      const float* weight = map.static_map().WeightBlock(BlockOf(v));
      std::printf("  missed surface %d %d %d: hits %d mean %.3f h weight %.2f\n", v.x(), v.y(),
                  v.z(), t.static_hits, mean ? mean[OffsetOf(v)] / h : 9.f,
                  weight ? weight[OffsetOf(v)] : 0.f);
    }
  }
  const int swept = r.ghosts[0] + r.ghosts[1] + r.ghosts[2];
  std::printf("swept, left, seen again: %d voxels: %d free, %d unknown, %d OCCUPIED\n", swept,
              r.ghosts[1], r.ghosts[0], r.ghosts[2]);
  std::printf("occupied a voxel or more from static surface: %d\n", r.phantoms);
  for (const auto& [name, n] : {std::pair{"", r.observed}, {"five or more ", r.well_observed}}) {
    const int hit = n[0] + n[1] + n[2];
    std::printf(
        "true surface with %sreturns: %d voxels: %.3f %% occupied, %.3f %% free, %.3f %% unknown\n",
        name, hit, 100.0 * n[2] / hit, 100.0 * n[1] / hit, 100.0 * n[0] / hit);
  }
  std::printf("true surface: %d voxels: free at high confidence %.4f %%, at low %.4f %%\n",
              r.truly_occupied, 100.0 * r.seen_high / r.truly_occupied,
              100.0 * r.seen_low / r.truly_occupied);
  if (!arguments.states.empty()) {
    std::ofstream out(arguments.states);
    out << "x,y,z,state\n";
    for (size_t i = 0; i < states.size(); ++i) {
      if (states[i].known == Known::kUnknown) continue;
      const Eigen::Vector3d c = VoxelCentre(states.VoxelOfIndex(i), h);
      if (c.z() < 0 || c.z() > 3) continue;
      out << c.x() << ',' << c.y() << ',' << c.z() << ',' << static_cast<int>(states[i].known)
          << '\n';
    }
  }
}

}  // namespace
}  // namespace clearance::evaluation

int main(int argc, char** argv) {
  try {
    clearance::evaluation::Run(clearance::evaluation::Parse(argc, argv));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
