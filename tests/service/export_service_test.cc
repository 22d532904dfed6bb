#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>

#include <sstream>

#include "server/core/crc32c.h"
#include "server/engine/live_map.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

// The file of a stream of chunks, each checked.
template <typename Response>
std::string ReadFile(grpc::ClientReader<Response>& reader, std::vector<Response>* chunks) {
  std::string file;
  Response chunk;
  while (reader.Read(&chunk)) {
    EXPECT_EQ(chunk.offset(), file.size());
    EXPECT_EQ(chunk.crc32c(), Crc32c(chunk.data()));
    EXPECT_LE(chunk.data().size(), 1u << 20);
    file += chunk.data();
    chunks->push_back(chunk);
  }
  if (!chunks->empty()) {
    EXPECT_EQ(chunks->front().total_bytes(), file.size());
  }
  return file;
}

class ExportServiceTest : public ServiceFixture {
 protected:
  grpc::Status Mesh(const v1::ExportMeshRequest& request, std::string* file,
                    std::vector<v1::ExportMeshResponse>* chunks) {
    grpc::ClientContext context;
    auto reader = exports_->ExportMesh(&context, request);
    *file = ReadFile(*reader, chunks);
    return reader->Finish();
  }
  grpc::Status Grid(const v1::ExportGridRequest& request, std::string* file,
                    std::vector<v1::ExportGridResponse>* chunks) {
    grpc::ClientContext context;
    auto reader = exports_->ExportGrid(&context, request);
    *file = ReadFile(*reader, chunks);
    return reader->Finish();
  }
};

TEST_F(ExportServiceTest, SendsAMeshInEitherFormat) {
  StartServer();
  v1::ExportMeshRequest request;
  std::string file;
  std::vector<v1::ExportMeshResponse> chunks;
  ASSERT_TRUE(Mesh(request, &file, &chunks).ok());
  EXPECT_EQ(file.substr(0, 4), "ply\n");
  EXPECT_EQ(chunks.at(0).vertices(), 3u);
  EXPECT_EQ(chunks.at(0).triangles(), 1u);
  request.set_format(v1::MESH_FORMAT_GLB);
  chunks.clear();
  ASSERT_TRUE(Mesh(request, &file, &chunks).ok());
  EXPECT_EQ(file.substr(0, 4), "glTF");
}

TEST_F(ExportServiceTest, RefusesWhatIsNotThere) {
  StartServer();
  std::string file;
  std::vector<v1::ExportMeshResponse> chunks;
  v1::ExportMeshRequest request;
  request.set_object_id(5);
  EXPECT_EQ(Mesh(request, &file, &chunks).error_code(), Code::NOT_FOUND);
  request.set_object_id(0);
  EXPECT_EQ(Mesh(request, &file, &chunks).error_code(), Code::INVALID_ARGUMENT);
  request.Clear();
  request.set_format(static_cast<v1::MeshFormat>(8));
  EXPECT_EQ(Mesh(request, &file, &chunks).error_code(), Code::INVALID_ARGUMENT);
  request.Clear();
  request.set_map("nowhere");
  EXPECT_EQ(Mesh(request, &file, &chunks).error_code(), Code::NOT_FOUND);
  request.Clear();
  request.mutable_consistency()->set_min_revision(3);
  EXPECT_EQ(Mesh(request, &file, &chunks).error_code(), Code::ABORTED);
  v1::ExportGridRequest grid;
  std::vector<v1::ExportGridResponse> grid_chunks;
  grid.add_kinds(v1::GRID_KIND_MEAN);
  grid.add_kinds(v1::GRID_KIND_MEAN);
  const grpc::Status twice = Grid(grid, &file, &grid_chunks);
  EXPECT_EQ(twice.error_code(), Code::INVALID_ARGUMENT);
  EXPECT_THAT(twice.error_message(), HasSubstr("kinds[1]"));
  grid.Clear();
  grid.add_kinds(v1::GRID_KIND_DISTANCE);
  grid.set_object_id(5);
  EXPECT_EQ(Grid(grid, &file, &grid_chunks).error_code(), Code::INVALID_ARGUMENT);
}

TEST_F(ExportServiceTest, AnExportIsOneFileOfManyChunksThatOpenVdbReads) {
  RegistryOptions registry;
  registry.model = LiveMapFactory();
  StartServer(std::move(registry));
  // A ball of known size, by hand: no sensor needed.
  grpc::ClientContext context;
  v1::EditRegionRequest edit;
  edit.set_action(v1::EDIT_ACTION_MARK_OCCUPIED);
  edit.mutable_sphere()->mutable_center()->set_x_m(-3);
  edit.mutable_sphere()->set_radius_m(2);
  v1::EditRegionResponse edited;
  ASSERT_TRUE(map_->EditRegion(&context, edit, &edited).ok());
  v1::ExportGridRequest request;
  for (const auto kind : {v1::GRID_KIND_MEAN, v1::GRID_KIND_WEIGHT, v1::GRID_KIND_FREE_SPACE,
                          v1::GRID_KIND_DISTANCE}) {
    request.add_kinds(kind);
  }
  std::string file;
  std::vector<v1::ExportGridResponse> chunks;
  const grpc::Status status = Grid(request, &file, &chunks);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_GT(chunks.size(), 1u);
  EXPECT_EQ(chunks.back().stamp().revision(), 1u);
  std::istringstream in(file);
  const openvdb::GridPtrVecPtr grids = openvdb::io::Stream(in).getGrids();
  ASSERT_EQ(grids->size(), 4u);
  const auto grid_named = [&](const char* name) -> openvdb::GridBase::Ptr {
    for (const auto& grid : *grids) {
      if (grid->getName() == name) return grid;
    }
    return nullptr;
  };
  for (const char* name : {"mean", "weight", "free_space", "distance"}) {
    ASSERT_TRUE(grid_named(name)) << name;
    EXPECT_GT(grid_named(name)->activeVoxelCount(), 0u) << name;
  }
  // Cell-centred: the value at a voxel belongs to its centre.
  const auto distance = openvdb::gridPtrCast<openvdb::FloatGrid>(grid_named("distance"));
  auto accessor = distance->getAccessor();
  double worst = 0;
  for (int x = -5; x < 40; ++x) {
    const openvdb::Coord voxel(x, 3, -4);
    const openvdb::Vec3d p = distance->indexToWorld(voxel);
    EXPECT_NEAR(p.x(), (x + 0.5) * 0.1, 1e-9);
    const double truth = (p - openvdb::Vec3d(-3, 0, 0)).length() - 2;
    worst = std::max(worst, std::abs(accessor.getValue(voxel) - truth));
  }
  EXPECT_LT(worst, 0.05);
}

}  // namespace
}  // namespace clearance
