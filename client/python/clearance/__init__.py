"""Clearance: distances to the nearest obstacle in a world that moves.

    from clearance import Client
    with Client("127.0.0.1:50051") as client:
        distances = client.distances([[10.0, 2.0, 0.5]], horizon_s=1.0)

The generated messages are `clearance.v1` (for example `from clearance.v1 import query_pb2`).
"""

import pkgutil

# The generated clearance/v1 may lie elsewhere on the path: in <build>/python.
__path__ = pkgutil.extend_path(__path__, __name__)

from clearance.arrays import FREE, OCCUPIED, UNKNOWN
from clearance.client import Answers, Client
from clearance.errors import ClearanceError
from clearance.frames import cloud_frame, depth_frame, object_motion, pose
from clearance.ingest import IngestStream
from clearance.queries import Pin, RegionBlock, SphereAnswers

__all__ = [
    "Answers",
    "Client",
    "ClearanceError",
    "FREE",
    "IngestStream",
    "OCCUPIED",
    "Pin",
    "RegionBlock",
    "SphereAnswers",
    "UNKNOWN",
    "cloud_frame",
    "depth_frame",
    "object_motion",
    "pose",
]
