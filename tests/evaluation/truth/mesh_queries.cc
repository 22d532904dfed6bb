// Exact geometric queries on triangle meshes with Embree, and the counting of rays through voxels,
// behind a C interface that the evaluation programs load with ctypes.
//
// Arrays are row-major doubles unless stated. Embree works in float, so each mesh is kept relative
// to the centre of its own box; distances and nearest points are computed in double.

#include <embree3/rtcore.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
using Points = Eigen::Map<const Eigen::Matrix3Xd>;  // columns: the rows of the caller's array

struct Mesh {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3Xd vertices;  // relative to centre
  std::vector<uint32_t> faces;
};

Eigen::Vector3d NearestOnTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                  const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double area2 = normal.squaredNorm();
  if (area2 > 0.0) {
    // Barycentric coordinates of the foot of the perpendicular.
    const double u = (c - b).cross(p - b).dot(normal) / area2;
    const double v = (a - c).cross(p - c).dot(normal) / area2;
    const double w = 1.0 - u - v;
    if (u >= 0.0 && v >= 0.0 && w >= 0.0) return u * a + v * b + w * c;
  }
  Eigen::Vector3d best = a;
  const Eigen::Vector3d corners[4] = {a, b, c, a};
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d along = corners[i + 1] - corners[i];
    const double length2 = along.squaredNorm();
    const double t =
        length2 > 0.0 ? std::clamp((p - corners[i]).dot(along) / length2, 0.0, 1.0) : 0.0;
    const Eigen::Vector3d q = corners[i] + t * along;
    if ((p - q).squaredNorm() < (p - best).squaredNorm()) best = q;
  }
  return best;
}

struct NearestQuery {
  const Mesh* mesh;
  Eigen::Vector3d point;  // relative to the mesh's centre
  Eigen::Vector3d nearest;
  double distance;
  int face;
};

bool VisitTriangle(RTCPointQueryFunctionArguments* args) {
  auto* q = static_cast<NearestQuery*>(args->userPtr);
  const uint32_t* f = &q->mesh->faces[3 * args->primID];
  const auto& v = q->mesh->vertices;
  const Eigen::Vector3d near = NearestOnTriangle(q->point, v.col(f[0]), v.col(f[1]), v.col(f[2]));
  const double distance = (near - q->point).norm();
  if (distance >= q->distance) return false;
  q->distance = distance;
  q->nearest = near;
  q->face = static_cast<int>(args->primID);
  // Rounded up, so that no nearer triangle is lost to float.
  args->query->radius = static_cast<float>(distance) * 1.00001f + 1e-6f;
  return true;
}

RTCRay MakeRay(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double far) {
  RTCRay ray{};
  ray.org_x = static_cast<float>(origin.x());
  ray.org_y = static_cast<float>(origin.y());
  ray.org_z = static_cast<float>(origin.z());
  ray.dir_x = static_cast<float>(direction.x());
  ray.dir_y = static_cast<float>(direction.y());
  ray.dir_z = static_cast<float>(direction.z());
  ray.tfar = static_cast<float>(far);
  ray.mask = ~0u;
  return ray;
}

struct CountingContext {
  RTCIntersectContext base;
  int winding;
};

// Counts surfaces crossed outwards minus those crossed inwards, and goes on.
void CountCrossing(const RTCFilterFunctionNArguments* args) {
  auto* context = reinterpret_cast<CountingContext*>(args->context);
  const auto* ray = reinterpret_cast<const RTCRay*>(args->ray);
  const auto* hit = reinterpret_cast<const RTCHit*>(args->hit);
  const float leaving = ray->dir_x * hit->Ng_x + ray->dir_y * hit->Ng_y + ray->dir_z * hit->Ng_z;
  context->winding += leaving > 0.0f ? 1 : -1;
  args->valid[0] = 0;
}

template <typename Body>
void ForEach(size_t count, const Body& body) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 256),
                    [&](const tbb::blocked_range<size_t>& range) {
                      for (size_t i = range.begin(); i < range.end(); ++i) body(i);
                    });
}

}  // namespace

extern "C" {

Mesh* truth_mesh_new(const double* vertices, size_t vertex_count, const uint32_t* faces,
                     size_t face_count) {
  auto* mesh = new Mesh;
  const Points given(vertices, 3, static_cast<Eigen::Index>(vertex_count));
  if (vertex_count > 0) {
    mesh->centre = 0.5 * (given.rowwise().minCoeff() + given.rowwise().maxCoeff());
  }
  mesh->vertices = given.colwise() - mesh->centre;
  mesh->faces.assign(faces, faces + 3 * face_count);
  mesh->device = rtcNewDevice(nullptr);
  mesh->scene = rtcNewScene(mesh->device);
  rtcSetSceneFlags(mesh->scene, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST |
                                                           RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION));
  RTCGeometry geometry = rtcNewGeometry(mesh->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* v = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                        RTC_FORMAT_FLOAT3, 12, vertex_count));
  for (size_t i = 0; i < 3 * vertex_count; ++i) v[i] = static_cast<float>(mesh->vertices(i));
  auto* f = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0,
                                                           RTC_FORMAT_UINT3, 12, face_count));
  std::copy(mesh->faces.begin(), mesh->faces.end(), f);
  rtcSetGeometryPointQueryFunction(geometry, VisitTriangle);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(mesh->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(mesh->scene);
  return mesh;
}

void truth_mesh_free(Mesh* mesh) {
  rtcReleaseScene(mesh->scene);
  rtcReleaseDevice(mesh->device);
  delete mesh;
}

// Unsigned distance, nearest point (n x 3) and its triangle (-1: the mesh is empty).
void truth_nearest(const Mesh* mesh, const double* points, size_t count, double* distances,
                   double* nearest, int32_t* faces) {
  ForEach(count, [&](size_t i) {
    NearestQuery query{mesh, Eigen::Map<const Eigen::Vector3d>(points + 3 * i) - mesh->centre,
                       Eigen::Vector3d::Zero(), kInfinity, -1};
    RTCPointQuery probe;
    probe.x = static_cast<float>(query.point.x());
    probe.y = static_cast<float>(query.point.y());
    probe.z = static_cast<float>(query.point.z());
    probe.radius = std::numeric_limits<float>::infinity();
    probe.time = 0.0f;
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(mesh->scene, &probe, &context, nullptr, &query);
    distances[i] = query.distance;
    Eigen::Map<Eigen::Vector3d>(nearest + 3 * i) = query.nearest + mesh->centre;
    faces[i] = query.face;
  });
}

// Whether a ray from the point along `direction` leaves more surfaces than it enters, which it does
// from inside a closed mesh, or several overlapping ones.
void truth_inside(const Mesh* mesh, const double* points, size_t count, const double* direction,
                  uint8_t* inside) {
  const Eigen::Map<const Eigen::Vector3d> d(direction);
  ForEach(count, [&](size_t i) {
    const Eigen::Vector3d origin = Eigen::Map<const Eigen::Vector3d>(points + 3 * i) - mesh->centre;
    CountingContext context;
    rtcInitIntersectContext(&context.base);
    context.base.filter = CountCrossing;
    context.winding = 0;
    RTCRayHit ray{MakeRay(origin, d, kInfinity), {}};
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(mesh->scene, &context.base, &ray);
    inside[i] = context.winding > 0;
  });
}

// Whether the mesh blocks the view from `eye` to each target; the last `slack_m` do not count.
void truth_blocked(const Mesh* mesh, const double* eye, const double* targets, size_t count,
                   double slack_m, uint8_t* blocked) {
  const Eigen::Vector3d origin = Eigen::Map<const Eigen::Vector3d>(eye) - mesh->centre;
  ForEach(count, [&](size_t i) {
    const Eigen::Vector3d to =
        Eigen::Map<const Eigen::Vector3d>(targets + 3 * i) - mesh->centre - origin;
    const double length = to.norm();
    blocked[i] = 0;
    if (length <= slack_m) return;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay ray = MakeRay(origin, to, 1.0 - slack_m / length);
    rtcOccluded1(mesh->scene, &context, &ray);
    blocked[i] = ray.tfar < 0.0f;
  });
}

// Counts the rays from `eye` to `ends` that pass right through cells of a dense grid: they enter
// and leave the cell before they end. Cell (i, j, k) is the cube from origin + voxel * (i, j, k),
// at index (i * ny + j) * nz + k. Only cells with 0 <= open_after[cell] < frame are counted.
void truth_count_rays(const double* eye, const double* ends, size_t count, const double* origin,
                      double voxel_m, const int64_t* size, const int32_t* open_after, int32_t frame,
                      uint32_t* counts) {
  const Eigen::Vector3d from =
      (Eigen::Map<const Eigen::Vector3d>(eye) - Eigen::Map<const Eigen::Vector3d>(origin)) /
      voxel_m;
  const Points targets(ends, 3, static_cast<Eigen::Index>(count));
  ForEach(count, [&](size_t r) {
    const Eigen::Vector3d to =
        (targets.col(static_cast<Eigen::Index>(r)) - Eigen::Map<const Eigen::Vector3d>(origin)) /
        voxel_m;
    const Eigen::Vector3d direction = to - from;
    double enter = 0.0;
    double leave = 1.0;
    for (int a = 0; a < 3; ++a) {
      const double high = static_cast<double>(size[a]);
      if (direction[a] == 0.0) {
        if (from[a] < 0.0 || from[a] >= high) leave = -1.0;
        continue;
      }
      const double t0 = -from[a] / direction[a];
      const double t1 = (high - from[a]) / direction[a];
      enter = std::max(enter, std::min(t0, t1));
      leave = std::min(leave, std::max(t0, t1));
    }
    if (enter >= leave) return;
    int64_t cell[3];
    int64_t step[3];
    double next[3];
    double delta[3];
    for (int a = 0; a < 3; ++a) {
      const double at = from[a] + enter * direction[a];
      cell[a] = std::clamp<int64_t>(static_cast<int64_t>(std::floor(at)), 0, size[a] - 1);
      step[a] = direction[a] > 0.0 ? 1 : -1;
      delta[a] = direction[a] != 0.0 ? 1.0 / std::abs(direction[a]) : kInfinity;
      const double face = static_cast<double>(cell[a] + (direction[a] > 0.0 ? 1 : 0));
      next[a] = direction[a] != 0.0 ? (face - from[a]) / direction[a] : kInfinity;
    }
    while (true) {
      const int a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
      if (next[a] >= 1.0) break;  // the ray ends in this cell
      const int64_t index = (cell[0] * size[1] + cell[1]) * size[2] + cell[2];
      if (open_after[index] >= 0 && open_after[index] < frame) {
        // Sums do not depend on the order of the threads.
        std::atomic_ref<uint32_t>(counts[index]).fetch_add(1, std::memory_order_relaxed);
      }
      cell[a] += step[a];
      if (cell[a] < 0 || cell[a] >= size[a]) break;
      next[a] += delta[a];
    }
  });
}

}  // extern "C"
