// A connection to a Clearance server.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/credentials.h"
#include "client/ingest_stream.h"
#include "client/types.h"

namespace clearance::client {

struct ClientOptions {
  // "HOST:PORT", "unix:/path" or the path of a unix socket.
  std::string address = "127.0.0.1:50051";
  std::string map;  // the map of calls that name none; empty is `default`
  Credentials credentials;
  absl::Duration connect_timeout = absl::Seconds(3);
  absl::Duration call_timeout = absl::Seconds(30);
  absl::Duration export_timeout = absl::Minutes(5);
};

// All calls block until answered or until their timeout (DEADLINE_EXCEEDED). Errors of the server
// keep its code and text; UNAVAILABLE says what was tried and what to do. Safe to use from several
// threads at once.
class EsdfClient {
 public:
  // Waits for the server up to connect_timeout; UNAVAILABLE with the cause where it is not there,
  // NOT_FOUND or INVALID_ARGUMENT for credentials that cannot be read.
  static absl::StatusOr<std::unique_ptr<EsdfClient>> Connect(const ClientOptions& options);
  ~EsdfClient();

  const ClientOptions& options() const;

  // Distances at `points_W` (3 x n, n from 1 to 100,000), one revision.
  absl::StatusOr<DistanceAnswers> QueryPoints(const Eigen::Matrix3Xd& points_W,
                                              const QueryOptions& options = {}) const;
  absl::StatusOr<ObjectList> ListObjects(bool include_history,
                                         const QueryOptions& options = {}) const;
  absl::StatusOr<Slice> GetSlice(const SliceOptions& options) const;

  // The empty map is the client's.
  absl::StatusOr<MapInfo> GetMap(const std::string& map = "",
                                 bool include_trajectory = false) const;
  absl::StatusOr<std::vector<MapInfo>> ListMaps() const;
  absl::StatusOr<MapInfo> CreateMap(const std::string& map,
                                    const wire::MapSettings& settings) const;
  absl::Status DeleteMap(const std::string& map) const;
  // The revision that includes the edit.
  absl::StatusOr<MapStamp> EditRegion(const std::string& map, const wire::EditRegion& edit) const;

  // Snapshots of a map on the server's disk; an empty id is named by the server. Restoring starts a
  // new epoch and ends the map's ingest streams. FAILED_PRECONDITION where the server keeps
  // nothing.
  absl::StatusOr<SnapshotInfo> CreateSnapshot(const std::string& map,
                                              const std::string& snapshot_id = "",
                                              const std::string& comment = "") const;
  absl::StatusOr<std::vector<SnapshotInfo>> ListSnapshots(const std::string& map) const;
  absl::StatusOr<MapStamp> RestoreSnapshot(const std::string& map,
                                           const std::string& snapshot_id) const;
  absl::Status DeleteSnapshot(const std::string& map, const std::string& snapshot_id) const;

  // Files arrive in checked chunks; DATA_LOSS where one is missing or damaged.
  absl::StatusOr<ExportResult> ExportMesh(const MeshOptions& options, const ByteSink& sink) const;
  absl::StatusOr<ExportResult> ExportGrid(const GridOptions& options, const ByteSink& sink) const;

  // True while serving. NOT_FOUND for a service the server does not know.
  absl::StatusOr<bool> IsServing(const std::string& service = "") const;
  absl::StatusOr<ServerInfo> GetServerInfo() const;
  // Of one map, or of all where `map` is empty.
  absl::StatusOr<ServerStats> GetStats(const std::string& map) const;
  // Stops taking frames and settles what waits; the server then answers UNAVAILABLE until it is
  // stopped. Returns how many frames it settled meanwhile. 0 s = the server's own limit.
  absl::StatusOr<uint64_t> Drain(double timeout_s) const;

  // Opens a source's stream; see IngestStream.
  absl::StatusOr<std::unique_ptr<IngestStream>> OpenIngest(IngestOptions options) const;

 private:
  struct Connection;
  explicit EsdfClient(std::unique_ptr<Connection> connection);

  std::unique_ptr<Connection> connection_;
};

}  // namespace clearance::client
