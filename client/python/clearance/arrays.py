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


def array(data, dtype, columns=1):
    """A read-only view of packed bytes: (n,) or (n, columns)."""
    values = np.frombuffer(data, dtype)
    return values if columns == 1 else values.reshape(-1, columns)
