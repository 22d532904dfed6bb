"""A connection to a Clearance server."""

import collections

import grpc

from clearance import arrays, channel
from clearance.errors import ClearanceError
from clearance.ingest import IngestStream
from clearance.v1 import (common_pb2, ingest_pb2_grpc, map_pb2, map_pb2_grpc, query_pb2,
                          query_pb2_grpc, watch_pb2, watch_pb2_grpc)

Answers = collections.namedtuple(
    "Answers", "distances_m states gradients object_ids sigmas_m objects stamp reference_ns")
Answers.__doc__ = """Answers in the order of the points.

distances_m (n,) float32; states (n,) uint8: UNKNOWN, FREE or OCCUPIED in the low two bits, flags
above; gradients (n, 3) float32, unit, in the world; object_ids (n,) uint32, 0 = static; sigmas_m
(n,) float32; objects: the ObjectBrief messages of those ids; stamp: the MapStamp.
"""


class Client:
    """Safe to use from several threads. Calls raise ClearanceError."""

    def __init__(self, address="127.0.0.1:50051", map="", timeout_s=30.0, connect_timeout_s=3.0, *,
                 token="", tls_ca="", tls_certificate="", tls_key=""):
        """`token` goes with every call; tls_*: paths of PEM files, as of the clearance command."""
        self.map = map
        self._timeout_s = timeout_s
        self._channel = channel.open_channel(address, token, tls_ca, tls_certificate, tls_key)
        try:
            grpc.channel_ready_future(self._channel).result(timeout=connect_timeout_s)
        except grpc.FutureTimeoutError:
            self._channel.close()
            raise ClearanceError(
                grpc.StatusCode.UNAVAILABLE,
                f"cannot reach the server at {address} within {connect_timeout_s:g} s; "
                "is clearance_server running there?") from None
        self._query = query_pb2_grpc.QueryServiceStub(self._channel)
        self._maps = map_pb2_grpc.MapServiceStub(self._channel)
        self._watch = watch_pb2_grpc.WatchServiceStub(self._channel)
        self._ingest = ingest_pb2_grpc.IngestServiceStub(self._channel)

    def close(self):
        self._channel.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def distances(self, xyz, horizon_s=0.0):
        """Distances (n,) float32 in metres from the (n, 3) points to the nearest surface."""
        return self.query(xyz, horizon_s, gradients=False, objects=False, sigmas=False).distances_m

    def query(self, xyz, horizon_s=0.0, *, gradients=True, objects=True, sigmas=True,
              static_only=False, weighted=False, sigma_margin=0.0, min_revision=0, wait_s=0.0):
        """Everything about the (n, 3) points, `horizon_s` after the map's stamp, as Answers."""
        request = query_pb2.QueryPointsRequest(
            map=self.map, positions_f64=arrays.points_bytes(xyz, "<f8"), horizon_s=horizon_s,
            gradients=gradients, objects=objects, sigmas=sigmas, sigma_margin=sigma_margin)
        if weighted:
            request.fusion = common_pb2.FUSION_WEIGHTED
        request.layers.static_only = static_only
        request.consistency.min_revision = min_revision
        request.consistency.wait_s = wait_s
        reply = self._call(self._query.QueryPoints, request)
        return Answers(
            arrays.array(reply.distances_f32, "<f4"), arrays.array(reply.states_u8, "u1"),
            arrays.array(reply.gradients_f32, "<f4", 3), arrays.array(reply.object_ids_u32, "<u4"),
            arrays.array(reply.sigmas_f32, "<f4"), list(reply.objects), reply.stamp,
            reply.reference_ns)

    def objects(self, horizon_s=0.0, include_history=False):
        """The ObjectInfo messages of all objects that the map remembers."""
        request = query_pb2.ListObjectsRequest(
            map=self.map, horizon_s=horizon_s, include_history=include_history)
        return list(self._call(self._query.ListObjects, request).objects)

    def create_map(self, map, voxel_size_m=0.0, max_range_m=0.0):
        """Makes an empty map (zeros are the server's defaults); returns its MapInfo."""
        config = map_pb2.MapConfig(voxel_size_m=voxel_size_m, max_range_m=max_range_m)
        request = map_pb2.CreateMapRequest(map=map, config=config)
        return self._call(self._maps.CreateMap, request).info

    def map_info(self):
        return self._call(self._maps.GetMap, map_pb2.GetMapRequest(map=self.map)).info

    def watch(self, max_rate_hz=0.0):
        """Follows the objects' poses; yields (stamp, objects) for each revision.

        stamp is the MapStamp; objects maps (object_id, generation) to its ObjectBrief, all that
        the map remembers. Ends with ClearanceError where the map is deleted or the server stops.
        """
        request = watch_pb2.WatchMapRequest(map=self.map, max_rate_hz=max_rate_hz, poses_only=True)
        call = self._watch.WatchMap(request)
        objects = {}
        try:
            for message in call:
                kind = message.WhichOneof("message")
                if kind == "hello":
                    if not message.hello.resumes:
                        objects = {}
                    continue
                part = getattr(message, kind)
                for state in part.objects:
                    objects[state.brief.object_id, state.brief.generation] = state.brief
                if kind == "delta":
                    for key in part.evicted_objects:
                        objects.pop((key.object_id, key.generation), None)
                if part.last_part:
                    yield message.stamp, dict(objects)
        except grpc.RpcError as error:
            raise ClearanceError(error.code(), error.details()) from None
        finally:
            call.cancel()

    def ingest(self, source_id="", max_range_m=0.0):
        """Opens a source's stream; see IngestStream."""
        return IngestStream(self._ingest, self.map, source_id, max_range_m)

    def _call(self, method, request):
        try:
            return method(request, timeout=self._timeout_s)
        except grpc.RpcError as error:
            raise ClearanceError(error.code(), error.details()) from None
