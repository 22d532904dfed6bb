"""Truly occupied space that is called free: the mistake that makes planners collide."""
import numpy as np
from scipy.spatial import cKDTree

import poses
from free_space import touches
from meshes import Mesh

_HALVES = np.array([[1, 0, 0], [.5, .5, 0], [.5, 0, .5], [0, 1, 0], [0, .5, .5], [0, 0, 1]])
_CHILDREN = [[0, 1, 2], [1, 3, 4], [2, 4, 5], [1, 4, 2]]
_CHUNK = 500_000
CONTACT = .05


def _small_triangles(corners, longest_m, low, high):
    """Triangles [n, 3, 3] split until no edge is longer than longest_m; what lies outside the box is dropped."""
    done = []
    while len(corners):
        corners = corners[((corners.min(1) <= high) & (corners.max(1) >= low)).all(1)]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
        done.append(corners[edges <= longest_m])
        big = corners[edges > longest_m]
        corners = np.einsum("hk,nkx->nhx", _HALVES, big)[:, _CHILDREN].reshape(-1, 3, 3)
    return np.concatenate(done)


def _unique(cells):
    if len(cells) == 0:
        return cells
    low = cells.min(0)
    size = cells.max(0) - low + 1
    key = ((cells[:, 0] - low[0]) * size[1] + cells[:, 1] - low[1]) * size[2] + cells[:, 2] - low[2]
    return cells[np.unique(key, return_index=True)[1]]


def surface_voxels(vertices, faces, voxel_m, near, within_m, most=None, seed=0):
    """Centres [n, 3] of the voxels whose cube contains surface, no farther than within_m from points `near`.

    Surface that only touches a cube's face (CONTACT of its size) is in neither of the two cubes.
    most: so many candidates at most, drawn at random.
    """
    low, high = near.min(0) - within_m, near.max(0) + within_m
    small = _small_triangles(vertices[faces], voxel_m, low, high)
    # Every point of such a triangle is within 0.58 voxel of its middle, by axis.
    reach = .58 * voxel_m * np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    parts = []
    for middle in np.array_split(small.mean(1), len(small) // _CHUNK + 1):
        cells = [np.floor((middle + r) / voxel_m).astype(np.int64) for r in reach]
        parts.append(_unique(np.concatenate(cells)))
    centres = (_unique(np.concatenate(parts)) + .5) * voxel_m
    if len(centres) == 0:
        return centres
    centres = centres[cKDTree(near).query(centres)[0] <= within_m]
    if most and len(centres) > most:
        centres = centres[np.random.default_rng(seed).choice(len(centres), most, replace=False)]
    return centres[touches(Mesh(vertices, faces), centres, voxel_m / 2 * (1 - CONTACT))]


def static_voxels(world, most=None):
    """Voxels that hold static surface, within the sensor's range of some frame."""
    sequence = world.sequence
    eyes = np.array([X[:3, 3] for X in sequence.sensor_poses])
    return surface_voxels(world.static.vertices, world.static.faces, sequence.voxel_m, eyes,
                          sequence.sensor["max_range_m"], most)


def object_voxels(world, j, frame):
    """Voxels that hold surface of object j that was ever in view, where it is at `frame`."""
    v, points = world.sequence.voxel_m, world.objects[j].sample(20000)
    seen = points[world.visible(j, points, range(world.sequence.frame_count))]
    cells = _unique(np.floor(poses.apply(world.pose(j, frame), seen) / v).astype(np.int64))
    return (cells + .5) * v


def judge(centres, answer):
    """Counts of truly occupied voxels by what answer(centres) says; shares of all and of those it knows."""
    got = answer(centres)
    free = got.states == 1
    counts = {"truly_occupied": len(centres), "occupied": int((got.states == 2).sum()),
              "unknown": int((got.states == 0).sum()), "free_high": int((free & ~got.low_confidence).sum()),
              "free_low": int((free & got.low_confidence).sum())}
    counts["known"] = counts["truly_occupied"] - counts["unknown"]
    for name in ("free_high", "free_low"):
        counts[f"{name}_share"] = counts[name] / max(counts["truly_occupied"], 1)
        counts[f"{name}_share_of_known"] = counts[name] / max(counts["known"], 1)
    return counts
