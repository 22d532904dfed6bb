"""Frames from numpy arrays."""

import numpy as np

from clearance import arrays
from clearance.v1 import common_pb2, ingest_pb2


def pose(translation_m, quaternion_xyzw=(0.0, 0.0, 0.0, 1.0)):
    """A Pose message."""
    tx, ty, tz = map(float, translation_m)
    qx, qy, qz, qw = map(float, quaternion_xyzw)
    return common_pb2.Pose(tx_m=tx, ty_m=ty, tz_m=tz, qx=qx, qy=qy, qz=qz, qw=qw)


def object_motion(object_id, world_motion=None, world_from_object=None, class_name=""):
    """How an object moved into the frame: exactly one of the two Pose messages."""
    return ingest_pb2.ObjectMotion(
        object_id=object_id, world_motion=world_motion, world_from_object=world_from_object,
        class_name=class_name)


def _labels_bytes(labels):
    return b"" if labels is None else np.ascontiguousarray(labels, "<u2").tobytes()


def cloud_frame(frame_id, stamp_ns, world_from_sensor, points, labels=None, motions=()):
    """A Frame of (n, 3) points in the sensor frame, metres, with (n,) labels (0 = static)."""
    return ingest_pb2.Frame(
        frame_id=frame_id, stamp_ns=stamp_ns, world_from_sensor=world_from_sensor, motions=motions,
        cloud=ingest_pb2.PointCloud(
            points_f32=arrays.points_bytes(points, "<f4"), labels_u16=_labels_bytes(labels)))


def depth_frame(frame_id, stamp_ns, world_from_sensor, depth, intrinsics, depth_scale_m,
                labels=None, motions=()):
    """A Frame of a (height, width) uint16 depth image; intrinsics = (fx, fy, cx, cy)."""
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    return ingest_pb2.Frame(
        frame_id=frame_id, stamp_ns=stamp_ns, world_from_sensor=world_from_sensor, motions=motions,
        depth=ingest_pb2.DepthImage(
            width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy, depth_scale_m=depth_scale_m,
            depth_u16=np.ascontiguousarray(depth, "<u2").tobytes(),
            labels_u16=_labels_bytes(labels)))
