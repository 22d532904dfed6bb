"""Error of the server's distances against the exact ones, where the nearest true surface was observed."""
import numpy as np
from scipy.spatial import cKDTree

import poses
from points import Collection


class ObservedSurface:
    """Recorded returns: the static ones in W, an object's in its own body frame."""

    def __init__(self, world, every=1):
        sequence, kept = world.sequence, {}
        self._voxel_m, self._world = sequence.voxel_m, world
        for k in range(0, sequence.frame_count, every):
            points, labels = sequence.scan(k)
            points = poses.apply(sequence.sensor_poses[k], points)
            for j in np.unique(labels):
                p = points[labels == j]
                if j:
                    p = poses.apply(poses.inverse(world.pose(j, k)), p)
                kept.setdefault(int(j), Collection(sequence.voxel_m / 2)).add(p)
        self._trees = {j: cKDTree(points.points()) for j, points in kept.items()}

    def contains(self, surface_points_W, owners, frame):
        """Whether a return lies within a voxel of each surface point."""
        near = np.zeros(len(surface_points_W), bool)
        for j, tree in self._trees.items():
            mine = owners == j
            p = surface_points_W[mine]
            if j:
                p = poses.apply(poses.inverse(self._world.pose(j, frame)), p)
            near[mine] = tree.query(p, distance_upper_bound=self._voxel_m)[0] < self._voxel_m
        return near


def points_in_the_open(sequence, count, seed=0, frames=None):
    """Points on the recorded rays, in front of what they hit: seen free when recorded."""
    rng, found = np.random.default_rng(seed), []
    frames = list(range(sequence.frame_count)) if frames is None else list(frames)
    share = int(np.ceil(count / len(frames)))
    for k in frames:
        points, labels = sequence.scan(k)
        points = points[labels == 0]  # what moves is elsewhere at the end
        ends = points[rng.integers(0, len(points), share)]
        along = rng.uniform(0, 1, (share, 1))
        reach = np.linalg.norm(ends, axis=1, keepdims=True)
        short = 1 - 1.5 * sequence.voxel_m / reach
        found.append(poses.apply(sequence.sensor_poses[k], ends * along * np.maximum(short, 0)))
    return np.concatenate(found)[:count]


def points_near_objects(world, count, within_m, frame, seed=0):
    """Points around the movers in view near the end of the recording, outside of everything."""
    rng, sequence = np.random.default_rng(seed), world.sequence
    seen = set()
    for k in range(max(0, sequence.frame_count - 10), sequence.frame_count):
        seen |= {int(j) for j in np.unique(sequence.scan(k)[1]) if j in world.objects}
    if not seen:
        return np.zeros((0, 3))
    found = []
    for j in sorted(seen):
        low, high = world.objects[j].vertices.min(0) - within_m, world.objects[j].vertices.max(0) + within_m
        p = poses.apply(world.pose(j, frame), rng.uniform(low, high, (4 * count // len(seen) + 1, 3)))
        found.append(p)
    points = rng.permutation(np.concatenate(found))
    distance, _, _ = world.distance(points, frame)
    to_objects, _, _ = world.distance(points, frame, static=False)
    return points[(distance > 0) & (to_objects < within_m)][:count]


def statistics(error_m, voxel_m):
    """Mean, percentiles and shares of |error|, in voxels."""
    e = np.abs(error_m) / voxel_m
    if len(e) == 0:
        return {"points": 0}
    return {"points": len(e), "bias": float(np.mean(error_m) / voxel_m), "mean": float(e.mean()),
            "median": float(np.median(e)), "p95": float(np.percentile(e, 95)),
            "p99": float(np.percentile(e, 99)), "max": float(e.max()),
            "above_half": float((e > .5).mean())}


def evaluate(world, observed, points, answer, frame, max_distance_m, moving=True):
    """Errors of answer(points) -> (distances, states, object ids) at a frame, static alone or with movers.

    Two kinds of points do not count: those further than max_distance_m from any true surface, and
    those whose nearest true surface was never observed (their share is stated).
    """
    true, nearest, owner = world.distance(points, frame, objects=None if moving else [])
    near = (true > 0) & (true < max_distance_m)
    points, true, nearest, owner = points[near], true[near], nearest[near], owner[near]
    seen = observed.contains(nearest, owner, frame)
    distances, states, _ = answer(points)
    result = statistics((distances - true)[seen], world.sequence.voxel_m)
    result["observed_share"] = float(seen.mean()) if len(seen) else 0.0
    result["called_occupied"] = float((states[seen] == 2).mean()) if seen.any() else 0.0
    result["unknown"] = float((states[seen] == 0).mean()) if seen.any() else 0.0
    return result
