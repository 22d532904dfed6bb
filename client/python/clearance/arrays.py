"""Bulk arrays of the contract as numpy arrays (little-endian, without copies where possible)."""

import numpy as np

# The low two bits of a state byte; flags are above them.
UNKNOWN, FREE, OCCUPIED = 0, 1, 2
FLAG_PREDICTED = 0x04
FLAG_CLAMPED = 0x08
FLAG_NO_GRADIENT = 0x10
FLAG_OUTSIDE_BOUNDS = 0x20
FLAG_STALE = 0x40
FLAG_LOW_CONFIDENCE = 0x80


def points_bytes(xyz, dtype):
    """An (n, 3) array-like of finite metres as packed bytes; a single point may be (3,)."""
    points = np.asarray(xyz, dtype)
    if points.ndim == 1:
        points = points[None, :]
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points: got shape {np.shape(xyz)}, expected (n, 3)")
    return np.ascontiguousarray(points).tobytes()


def numbers_bytes(values, dtype):
    """A sequence of numbers as packed bytes."""
    numbers = np.asarray(values, dtype)
    if numbers.ndim != 1:
        raise ValueError(f"numbers: got shape {np.shape(values)}, expected (n,)")
    return np.ascontiguousarray(numbers).tobytes()


def spheres_bytes(spheres):
    """(k, 4) x, y, z, radius in the robot frame, metres; a single one may be (4,)."""
    values = np.atleast_2d(np.asarray(spheres, "<f4"))
    if values.ndim != 2 or values.shape[1] != 4:
        raise ValueError(f"spheres: got shape {np.shape(spheres)}, expected (k, 4)")
    return np.ascontiguousarray(values).tobytes()


def poses_bytes(poses):
    """(m, 7) tx, ty, tz, qx, qy, qz, qw, or (m, 3) positions without rotation, as packed bytes."""
    values = np.atleast_2d(np.asarray(poses, "<f8"))
    if values.ndim == 2 and values.shape[1] == 3:
        values = np.hstack([values, np.tile([0.0, 0.0, 0.0, 1.0], (len(values), 1))])
    if values.ndim != 2 or values.shape[1] != 7:
        raise ValueError(f"poses: got shape {np.shape(poses)}, expected (m, 7) or (m, 3)")
    return np.ascontiguousarray(values, "<f8").tobytes()


def array(data, dtype, columns=1):
    """A read-only view of packed bytes: (n,) or (n, columns)."""
    values = np.frombuffer(data, dtype)
    return values if columns == 1 else values.reshape(-1, columns)
