// What an ExportMesh asks for, extracted on the mapping thread, written elsewhere.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "clearance/v1/export.pb.h"
#include "server/engine/frame_ack.h"
#include "server/engine/map_model.h"
#include "server/query/mesh.h"

namespace clearance {

struct MeshSelection {
  ObjectId object;  // 0 = the static map
  uint32_t generation = 0;
  bool glb = false;
  bool world_frame = true;
};

// INVALID_ARGUMENT for an object id out of range or an unknown format or frame.
absl::StatusOr<MeshSelection> MeshSelectionFromProto(const v1::ExportMeshRequest& request);

struct MeshCopy {
  RevisionStamp stamp;
  Pose T_W_L = Pose::Identity();
  Mesh mesh;  // in L (the static map's: in W)
};

// On the mapping thread. NOT_FOUND for an unknown object.
absl::StatusOr<MeshCopy> TakeMesh(const MeshSelection& selection, MapModel* model,
                                  const MapView& view);
std::string WriteMesh(const MeshSelection& selection, const MeshCopy& copy);
v1::ExportMeshResponse MeshHeader(const MeshCopy& copy);
void FillFirst(const MeshSelection& selection, const MeshCopy& copy, v1::ExportMeshResponse* first);

}  // namespace clearance
