"""Rigid motions as 4x4 float64 matrices: T_A_B maps coordinates in B to A."""
import numpy as np
from scipy.spatial.transform import Rotation


def from_tq(row):
    """From tx ty tz qx qy qz qw."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(row[3:7]).as_matrix()
    T[:3, 3] = row[:3]
    return T


def to_tq(T):
    """The reverse: tx ty tz qx qy qz qw."""
    return np.r_[T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()]


def inverse(T):
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def apply(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def between(A, B, share):
    """From A (share 0) to B (share 1): linear in position, along the shortest turn."""
    T = np.eye(4)
    turn = Rotation.from_matrix(A[:3, :3].T @ B[:3, :3]).as_rotvec()
    T[:3, :3] = A[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    T[:3, 3] = (1 - share) * A[:3, 3] + share * B[:3, 3]
    return T


def power(H, exponent):
    """The screw motion H, `exponent` times over: constant twist. power(H, 1) is H."""
    turn = Rotation.from_matrix(H[:3, :3]).as_rotvec()
    angle, T = np.linalg.norm(turn), np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(exponent * turn).as_matrix()
    if angle < 1e-9:
        T[:3, 3] = exponent * H[:3, 3]
        return T
    axis = turn / angle
    along = axis * (axis @ H[:3, 3])
    # The point of the axis: c = R c + t across it.
    across = H[:3, 3] - along
    centre = np.linalg.lstsq(np.eye(3) - H[:3, :3], across, rcond=None)[0]
    T[:3, 3] = centre - T[:3, :3] @ centre + exponent * along
    return T
