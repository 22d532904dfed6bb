"""Space that objects drove through and that was seen again must be free.

Counted are voxels
  * whose centre lay in an object at some frame (its true mesh; a recording's annotated box),
  * at least one voxel from any truly static surface,
  * with three or more rays of later frames through them (they enter and leave the voxel before they
    end), after the last object had left the voxel and its neighbours.
A ghost is one of these that the static map calls occupied.
"""
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

import poses
from meshes import Mesh, VoxelGrid
from points import Collection

RAYS = 3
# A recording has no true surfaces. A static-labelled return counts as truly static where no
# annotated box of a mover, grown by this much, contains it in its own frame; one that does contain
# it says that the mover is still there.
BOX_MARGIN_M = 0.5


@dataclass
class SweptSpace:
    centres: np.ndarray      # [n, 3] voxels to be judged
    swept: int               # voxels swept at all
    away_from_static: int    # of these, at least one voxel from static surfaces


def _boxes(sequence):
    """Meshes of the annotated boxes, in the body frame at the box's centre."""
    corners = np.array([[x, y, z] for x in (-.5, .5) for y in (-.5, .5) for z in (-.5, .5)])
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return {j: Mesh(corners * size, faces) for j, size in sequence.box_sizes().items()
            if j in sequence.object_poses}


def _last_frame_swept(sequence, bodies, frames):
    """A grid over all swept space, and per voxel the last frame at which a body held its centre (-1: never)."""
    half = {j: np.abs(mesh.vertices).max(0) for j, mesh in bodies.items()}
    placed = [(k, j, sequence.object_poses[j][k]) for k in frames for j in bodies
              if k in sequence.object_poses[j]]
    reach = [np.abs(T[:3, :3]) @ half[j] for _, j, T in placed]
    low = np.min([T[:3, 3] - r for (_, _, T), r in zip(placed, reach)], 0) - 2 * sequence.voxel_m
    high = np.max([T[:3, 3] + r for (_, _, T), r in zip(placed, reach)], 0) + 2 * sequence.voxel_m
    # Only what the sensor can have seen, which bounds the grid.
    eyes = np.array([X[:3, 3] for X in sequence.sensor_poses])
    far = sequence.sensor["max_range_m"] + 1
    grid = VoxelGrid(np.maximum(low, eyes.min(0) - far), np.minimum(high, eyes.max(0) + far),
                     sequence.voxel_m)
    last = np.full(grid.size, -1, np.int32)
    for (k, j, T), r in zip(placed, reach):
        low_cell, _ = grid.index(T[:3, 3] - r)
        high_cell, _ = grid.index(T[:3, 3] + r)
        low_cell, high_cell = np.maximum(low_cell, 0), np.minimum(high_cell, grid.size - 1)
        if (low_cell > high_cell).any():
            continue
        cells = np.indices(high_cell - low_cell + 1).reshape(3, -1).T + low_cell
        held = bodies[j].inside(poses.apply(poses.inverse(T), grid.centres(cells)))
        i, h, d = cells[held].T
        last[i, h, d] = np.maximum(last[i, h, d], k)
    return grid, last


def _near_boxes(sequence, boxes, k, points_W):
    """Whether world points of frame k lie in an annotated box, grown by BOX_MARGIN_M."""
    near = np.zeros(len(points_W), bool)
    for j, mesh in boxes.items():
        if k in sequence.object_poses[j]:
            local = poses.apply(poses.inverse(sequence.object_poses[j][k]), points_W)
            near |= (np.abs(local) <= np.abs(mesh.vertices).max(0) + BOX_MARGIN_M).all(1)
    return near


def _split_returns(sequence, boxes, grid, last):
    """Thinned static returns of a recording that no mover can have caused. Raises `last` to the frame of
    any other return in a swept voxel: boxes are rough, and what returns there has not left yet."""
    static = Collection(sequence.voxel_m / 4)
    for k in range(sequence.frame_count):
        points, labels = sequence.scan(k)
        world = poses.apply(sequence.sensor_poses[k], points)
        near = _near_boxes(sequence, boxes, k, world)
        static.add(world[(labels == 0) & ~near])
        cells, inside = grid.index(world[near])
        i, h, d = cells[inside].T
        swept = last[i, h, d] >= 0
        i, h, d = i[swept], h[swept], d[swept]
        last[i, h, d] = np.maximum(last[i, h, d], k)
    return static.points()


def swept_space(sequence, world=None, scans=None):
    """The voxels to be judged, from the true shapes of `world` or a recording's boxes.

    scans: the recording whose rays count (default: the sequence itself).
    """
    bodies = world.objects if world else _boxes(sequence)
    frames = range(sequence.frame_count)
    grid, last = _last_frame_swept(sequence, bodies, frames)
    swept = last >= 0
    cells = np.argwhere(swept)
    centres = grid.centres(cells)
    if world:
        distance = np.abs(world.distance(centres, objects=[])[0])
    else:
        distance = cKDTree(_split_returns(sequence, bodies, grid, last)).query(centres)[0]
    clear = distance >= sequence.voxel_m
    # Left only once the neighbours are left too: bodies move between frames, and boxes are rough.
    left = maximum_filter(last, size=3)
    open_after = np.full(grid.size, -1, np.int32)
    index = tuple(cells[clear].T)
    open_after[index] = left[index]
    counts = np.zeros(grid.size, np.uint32)
    for k in frames:
        points, _ = (scans or sequence).scan(k)
        X = sequence.sensor_poses[k]
        grid.count_rays(X[:3, 3], poses.apply(X, points), open_after, k, counts)
    judged = cells[clear][counts[index] >= RAYS]
    return SweptSpace(grid.centres(judged), len(cells), int(clear.sum()))


def evaluate(space, query_static_states):
    """Counts states of the static map; query_static_states(points) -> states 0 unknown, 1 free, 2 occupied."""
    states = query_static_states(space.centres) if len(space.centres) else np.zeros(0, int)
    return {"swept": space.swept, "away_from_static": space.away_from_static,
            "seen_again": len(space.centres), "free": int((states == 1).sum()),
            "unknown": int((states == 0).sum()), "ghosts": int((states == 2).sum())}, \
        space.centres[states == 2]
