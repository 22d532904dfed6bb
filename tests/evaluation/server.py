"""A server of our own, and what the evaluation asks of it (gRPC, through the Python client)."""
import collections
import pathlib
import subprocess
import sys
import tempfile
import time

import grpc
import numpy as np

import ply
import poses

LARGEST_BATCH = 100_000  # points of one query
Answer = collections.namedtuple("Answer", "distances states gradients owners low_confidence")
Answer.__doc__ = """Distances [n] m, states [n] (0 unknown, 1 free, 2 occupied), gradients [n, 3] (zero: none),
object ids [n] (0 static), low confidence flags [n]."""
Ack = collections.namedtuple("Ack", "frame status integrate_ms violations")


def _import_client(build, root):
    """The stubs lie in the build tree, beside a copy of the `clearance` package."""
    sys.path[:0] = [str(pathlib.Path(build) / "python"), str(pathlib.Path(root) / "client/python")]
    import clearance  # pylint: disable=import-outside-toplevel
    from clearance.v1 import (admin_pb2, admin_pb2_grpc, export_pb2, export_pb2_grpc, ingest_pb2,
                              ingest_pb2_grpc, map_pb2, map_pb2_grpc)
    return dict(clearance=clearance, admin=(admin_pb2, admin_pb2_grpc), export=(export_pb2, export_pb2_grpc),
                ingest=(ingest_pb2, ingest_pb2_grpc), map=(map_pb2, map_pb2_grpc))


class Server:
    """Starts clearance_server on a unix socket of its own; stops it at the end of the with block."""

    def __init__(self, build, root):
        self._bin, self._root = pathlib.Path(build) / "bin", pathlib.Path(root)
        self._api = _import_client(build, root)

    def __enter__(self):
        self._folder = tempfile.TemporaryDirectory()
        self._scratch = pathlib.Path(self._folder.name)
        self._log = open(self._scratch / "server.log", "w+")
        self._process = subprocess.Popen(
            [str(self._bin / "clearance_server"), "--config", str(self._root / "server/config/default.yaml"),
             "--listen", "127.0.0.1:0", "--socket", f"{self._scratch}/clearance.sock", "--http", "off"],
            stdout=self._log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
        try:
            self._wait_until_ready()
            self._connect()
        except Exception:
            self.__exit__()
            raise
        return self

    def _wait_until_ready(self):
        log = self._scratch / "server.log"
        for _ in range(300):
            if "ready\n" in log.read_text():
                return
            if self._process.poll() is not None:
                break
            time.sleep(.1)
        raise RuntimeError(f"the server did not start: {log.read_text()}")

    def _connect(self):
        address = f"unix:{self._scratch}/clearance.sock"
        self._channel = grpc.insecure_channel(address, options=[
            ("grpc.max_receive_message_length", 16 << 20), ("grpc.max_send_message_length", 16 << 20),
            ("grpc.enable_http_proxy", 0)])
        self._stubs = {name: getattr(services, f"{name.capitalize()}ServiceStub")(self._channel)
                       for name, services in ((n, self._api[n][1]) for n in ("admin", "export", "ingest", "map"))}
        self._client = self._api["clearance"].Client(address, timeout_s=600)

    def __exit__(self, *_):
        self._process.terminate()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
        self._folder.cleanup()

    def _call(self, method, request):
        try:
            return method(request, timeout=600)
        except grpc.RpcError as error:
            raise RuntimeError(f"{error.code().name}: {error.details()}") from None

    def create(self, map_id, voxel_m, max_range_m, max_distance_m):
        messages = self._api["map"][0]
        config = messages.MapConfig(voxel_size_m=voxel_m, max_range_m=max_range_m, max_distance_m=max_distance_m)
        self._call(self._stubs["map"].CreateMap, messages.CreateMapRequest(map=map_id, config=config))

    def delete(self, map_id):
        self._call(self._stubs["map"].DeleteMap, self._api["map"][0].DeleteMapRequest(map=map_id))

    def send(self, map_id, sequence, frame):
        """Sends one frame and waits until it is integrated."""
        messages = self._api["ingest"][0]
        request = messages.IngestFrameRequest(map=map_id, source_id="evaluation",
                                              frame=self._frame(sequence, frame))
        ack = self._call(self._stubs["ingest"].IngestFrame, request).ack
        status = messages.IngestStatus.Name(ack.status).removeprefix("INGEST_STATUS_").lower()
        return Ack(frame, status, ack.integrate_ms, [v.description for v in ack.violations])

    def _frame(self, sequence, k):
        client = self._api["clearance"]
        tq = poses.to_tq(sequence.sensor_poses[k])
        motions = []
        for j, from_frame, H in sequence.motions_of(k):
            h = poses.to_tq(H)
            motions.append(client.object_motion(j, world_motion=client.pose(h[:3], h[3:])))
            if from_frame is not None:
                motions[-1].from_frame_id = from_frame
        common = dict(frame_id=k, stamp_ns=int(round(sequence.times_s[k] * 1e9)),
                      world_from_sensor=client.pose(tq[:3], tq[3:]), motions=motions)
        if sequence.is_camera:
            depth, labels = sequence.images(k)
            s = sequence.sensor
            return client.depth_frame(depth=depth, labels=labels, depth_scale_m=s["depth_scale_m"],
                                      intrinsics=(s["fx"], s["fy"], s["cx"], s["cy"]), **common)
        points, labels = sequence.scan(k)
        return client.cloud_frame(points=points, labels=labels, **common)

    def query(self, map_id, points, horizon_s=0.0, static_only=False, weighted=False):
        """Answers at the (n, 3) points of W, in batches."""
        self._client.map = map_id
        parts = [self._client.query(points[i:i + LARGEST_BATCH], horizon_s, sigmas=False, static_only=static_only,
                                    weighted=weighted)
                 for i in range(0, len(points), LARGEST_BATCH)]
        if not parts:
            return Answer(np.zeros(0), np.zeros(0, int), np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, bool))
        states = np.concatenate([p.states for p in parts])
        return Answer(np.concatenate([p.distances_m for p in parts]).astype(float), (states & 3).astype(int),
                      np.concatenate([p.gradients for p in parts]).astype(float),
                      np.concatenate([p.object_ids for p in parts]).astype(int), (states & 0x80) > 0)

    def mesh(self, map_id, object_id=None, in_object_frame=False):
        """Vertices [n, 3] and triangles [m, 3]; the static map's without an id. RuntimeError: no such object."""
        messages = self._api["export"][0]
        request = messages.ExportMeshRequest(map=map_id)
        if object_id is None:
            request.static_map.SetInParent()
        else:
            request.object_id = object_id
        if in_object_frame:
            request.frame = messages.MESH_FRAME_OBJECT
        try:
            data = b"".join(chunk.data for chunk in self._stubs["export"].ExportMesh(request, timeout=600))
        except grpc.RpcError as error:
            raise RuntimeError(f"{error.code().name}: {error.details()}") from None
        return ply.parse_mesh(data)

    def stages(self, map_id):
        """{stage: {'count', 'p50_ms', 'p95_ms'}} of a map's frames, by the server's own clock, and its memory."""
        stats = self._call(self._stubs["admin"].GetStats, self._api["admin"][0].GetStatsRequest(map=map_id))
        found = next(m for m in stats.maps if m.map == map_id)
        return ({s.stage: {"count": s.latency.count, "p50_ms": s.latency.p50_ms, "p95_ms": s.latency.p95_ms}
                 for s in found.stages}, found.memory_bytes)
