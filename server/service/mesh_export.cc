#include "server/service/mesh_export.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/geometry.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"
#include "server/service/resolve.h"

namespace clearance {

absl::StatusOr<MeshSelection> MeshSelectionFromProto(const v1::ExportMeshRequest& request) {
  MeshSelection selection;
  if (request.has_object_id()) {
    const absl::StatusOr<ObjectId> id = wire::ObjectIdFromProto(request.object_id(), "object_id");
    if (!id.ok()) return id.status();
    selection.object = *id;
  }
  selection.generation = request.generation();
  if (!v1::MeshFormat_IsValid(request.format())) {
    return wire::InvalidField("format", -1, absl::StrFormat("%d", request.format()), "PLY or GLB");
  }
  if (!v1::MeshFrame_IsValid(request.frame())) {
    return wire::InvalidField("frame", -1, absl::StrFormat("%d", request.frame()),
                              "WORLD or OBJECT");
  }
  selection.glb = request.format() == v1::MESH_FORMAT_GLB;
  selection.world_frame = request.frame() != v1::MESH_FRAME_OBJECT;
  return selection;
}

absl::StatusOr<MeshCopy> TakeMesh(const MeshSelection& selection, MapModel* model,
                                  const MapView& view) {
  const absl::StatusOr<MapModel::Surface> surface =
      model->FindSurface(selection.object, selection.generation);
  if (!surface.ok()) return surface.status();
  absl::StatusOr<Mesh> mesh = model->ExtractMesh(selection.object, surface->generation);
  if (!mesh.ok()) return mesh.status();
  return MeshCopy{StampOf(view), surface->T_W_L, *std::move(mesh)};
}

std::string WriteMesh(const MeshSelection& selection, const MeshCopy& copy) {
  const auto write = [&](const Mesh& mesh) {
    return selection.glb ? WriteGlb(mesh) : WritePly(mesh);
  };
  if (selection.object.is_static() || !selection.world_frame) return write(copy.mesh);
  return write(Transformed(copy.mesh, copy.T_W_L));
}

v1::ExportMeshResponse MeshHeader(const MeshCopy& copy) {
  v1::ExportMeshResponse header;
  ToProto(copy.stamp, header.mutable_stamp());
  return header;
}

void FillFirst(const MeshSelection& selection, const MeshCopy& copy,
               v1::ExportMeshResponse* first) {
  first->set_vertices(copy.mesh.vertices.size());
  first->set_triangles(copy.mesh.triangles.size());
  if (!selection.object.is_static()) {
    wire::ToProto(copy.T_W_L, first->mutable_world_from_object());
  }
}

}  // namespace clearance
