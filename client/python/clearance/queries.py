"""What checks, regions, pins and pipelines answer."""

import collections
import queue

import grpc

from clearance import arrays
from clearance.errors import ClearanceError
from clearance.v1 import query_pb2

SphereAnswers = collections.namedtuple(
    "SphereAnswers", "collides clearances_m sphere_indices object_ids stamp reference_ns")
SphereAnswers.__doc__ = """One entry a pose.

collides (m,) bool; clearances_m (m,) float32: distance minus radius of the worst sphere, metres;
sphere_indices (m,): that sphere; object_ids (m,): what is nearest to it, 0 = static.
"""


class RegionBlock(collections.namedtuple(
        "RegionBlock", "origin resolution_m distances_m states gradients object_ids stamp")):
    """Dense cells indexed [z, y, x]; the centre of [0, 0, 0] is origin, (3,) metres.

    gradients (z, y, x, 3) and object_ids are None unless asked for.
    """

    @classmethod
    def of(cls, block):
        shape = (block.size_z, block.size_y, block.size_x)
        gradients = object_ids = None
        if block.gradients_f32:
            gradients = arrays.array(block.gradients_f32, "<f4").reshape(*shape, 3)
        if block.object_ids_u32:
            object_ids = arrays.array(block.object_ids_u32, "<u4").reshape(shape)
        return cls((block.origin.x_m, block.origin.y_m, block.origin.z_m), block.resolution_m,
                   arrays.array(block.distances_f32, "<f4").reshape(shape),
                   arrays.array(block.states_u8, "u1").reshape(shape), gradients, object_ids,
                   block.stamp)


class Pin:
    """A revision that stays answerable until it is released or `ttl_s` have passed."""

    def __init__(self, client, reply):
        self._client = client
        self.pin_id = reply.pin_id
        self.stamp = reply.stamp
        self.ttl_s = reply.ttl_s

    def release(self):
        self._client.release_pin(self.pin_id)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self.release()
        except ClearanceError as error:
            # It may have ended by itself.
            if error.code != grpc.StatusCode.NOT_FOUND:
                raise


_FIELDS = {
    query_pb2.QueryPointsRequest: "query_points",
    query_pb2.CheckTrajectoriesRequest: "check_trajectories",
    query_pb2.CheckSpheresRequest: "check_spheres",
    query_pb2.ListObjectsRequest: "list_objects",
    query_pb2.GetSliceRequest: "get_slice",
}
_CODES = {code.value[0]: code for code in grpc.StatusCode}


def pipeline(stub, map, requests):
    """Yields (index, response or ClearanceError) for request messages sent over one QueryStream."""
    failed = queue.SimpleQueue()

    def tagged():
        try:
            for index, request in enumerate(requests):
                message = query_pb2.QueryStreamRequest(tag=index)
                field = getattr(message, _FIELDS[type(request)])
                field.CopyFrom(request)
                field.map = field.map or map
                yield message
        except Exception as error:  # raised where the caller reads
            failed.put(error)

    call = stub.QueryStream(tagged())
    try:
        for reply in call:
            kind = reply.WhichOneof("response")
            if kind == "error":
                code = _CODES.get(reply.error.code, grpc.StatusCode.UNKNOWN)
                yield reply.tag, ClearanceError(code, reply.error.message)
            else:
                yield reply.tag, getattr(reply, kind)
    except grpc.RpcError as error:
        raise ClearanceError(error.code(), error.details()) from None
    finally:
        call.cancel()
    if not failed.empty():
        raise failed.get()
