"""Error of the server's distances and gradients against the exact ones, where the nearest true surface
was observed."""
import numpy as np
from scipy.spatial import cKDTree

import poses
from points import Collection

WITHIN_M = 2.0  # of objects


class ObservedSurface:
    """Recorded returns: the static ones in W, an object's in its own body frame."""

    def __init__(self, world, every=1):
        sequence, kept = world.sequence, {}
        self._voxel_m = sequence.voxel_m
        for k in range(0, sequence.frame_count, every):
            points, labels = sequence.scan(k)
            points = poses.apply(sequence.sensor_poses[k], points)
            for j in np.unique(labels):
                p = points[labels == j]
                if j:
                    if j not in world.objects:
                        continue
                    p = poses.apply(poses.inverse(world.pose(j, k)), p)
                kept.setdefault(int(j), Collection(sequence.voxel_m / 2)).add(p)
        self._trees = {j: cKDTree(points.points()) for j, points in kept.items()}

    def static_near(self, points_W, within_m):
        """Whether a static return lies so near to each point."""
        if 0 not in self._trees:
            return np.zeros(len(points_W), bool)
        return self._trees[0].query(points_W, distance_upper_bound=within_m)[0] < within_m

    def contains(self, surface_points_W, owners, placed):
        """Whether a return lies within a voxel of each surface point; placed: {object id: T_W_L}."""
        near = np.zeros(len(surface_points_W), bool)
        for j, tree in self._trees.items():
            mine = owners == j
            if not mine.any():
                continue
            p = surface_points_W[mine]
            if j:
                p = poses.apply(poses.inverse(placed[j]), p)
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
        if len(points) == 0:
            continue
        ends = points[rng.integers(0, len(points), share)]
        along = rng.uniform(0, 1, (share, 1))
        reach = np.linalg.norm(ends, axis=1, keepdims=True)
        short = 1 - 1.5 * sequence.voxel_m / reach
        found.append(poses.apply(sequence.sensor_poses[k], ends * along * np.maximum(short, 0)))
    return np.concatenate(found)[:count] if found else np.zeros((0, 3))


def movers_in_view(world, frames=10):
    """Ids of the objects with returns in the last frames of the recording."""
    sequence, seen = world.sequence, set()
    for k in range(max(0, sequence.frame_count - frames), sequence.frame_count):
        seen |= {int(j) for j in np.unique(sequence.scan(k)[1]) if j in world.objects}
    return sorted(seen)


def points_near_objects(world, movers, placed, count, seed=0):
    """Points up to WITHIN_M around movers at the poses `placed`, inside them too, outside of static solids."""
    rng, found = np.random.default_rng(seed), []
    for j in movers:
        low, high = world.objects[j].vertices.min(0) - WITHIN_M, world.objects[j].vertices.max(0) + WITHIN_M
        found.append(poses.apply(placed[j], rng.uniform(low, high, (3 * count // len(movers) + 1, 3))))
    if not found:
        return np.zeros((0, 3))
    points = rng.permutation(np.concatenate(found))
    to_static, _, _ = world.distance(points, objects=[])
    to_objects, _, _ = world.distance(points, static=False, placed=placed)
    return points[(to_static > 0) & (to_objects < WITHIN_M)][:count]


def statistics(error_m, voxel_m):
    """Mean, percentiles and shares of |error|, in voxels."""
    e = np.abs(error_m) / voxel_m
    if len(e) == 0:
        return {"points": 0}
    return {"points": len(e), "bias": float(np.mean(error_m) / voxel_m), "mean": float(e.mean()),
            "median": float(np.median(e)), "p95": float(np.percentile(e, 95)),
            "p99": float(np.percentile(e, 99)), "max": float(e.max()),
            "above_half": float((e > .5).mean())}


def gradient_statistics(points, nearest, true, gradients):
    """Angles in degrees between answered gradients and the exact ones, which are undefined on the surface."""
    known = (np.linalg.norm(gradients, axis=1) > .5) & (np.abs(true) > 1e-6)
    if not known.any():
        return {"gradients": 0}
    exact = (points[known] - nearest[known]) / true[known, None]
    cosine = np.clip(np.sum(exact * gradients[known], axis=1), -1, 1)
    angle = np.degrees(np.arccos(cosine))
    return {"gradients": int(known.sum()), "gradient_mean_deg": float(angle.mean()),
            "gradient_median_deg": float(np.median(angle)),
            "gradient_p95_deg": float(np.percentile(angle, 95))}


def evaluate(world, observed, points, answer, max_distance_m, placed=None):
    """Errors of answer(points) (an Answer) among the objects at the poses `placed` (None: static alone).

    Two kinds of points do not count: those further than max_distance_m from any true surface, and
    those whose nearest true surface was never observed (their share is stated). Points in solids
    count where they are asked for; their error is signed like any other.
    """
    objects = [] if placed is None else list(placed)
    true, nearest, owner = world.distance(points, objects=objects, placed=placed or {})
    near = np.abs(true) < max_distance_m
    points, true, nearest, owner = points[near], true[near], nearest[near], owner[near]
    seen = observed.contains(nearest, owner, placed or {}) if len(points) else np.zeros(0, bool)
    share = float(seen.mean()) if len(seen) else 0.0
    points, true, nearest, owner = points[seen], true[seen], nearest[seen], owner[seen]
    got = answer(points)
    error = got.distances - true

    def row(chosen):
        r = statistics(error[chosen], world.sequence.voxel_m)
        if r["points"]:
            r.update(gradient_statistics(points[chosen], nearest[chosen], true[chosen], got.gradients[chosen]))
            r["called_occupied"] = float((got.states[chosen] == 2).mean())
            r["called_free"] = float((got.states[chosen] == 1).mean())
            r["unknown"] = float((got.states[chosen] == 0).mean())
        r["observed_share"] = share
        return r
    outside = true > 0
    if placed is None:
        return {"open": row(outside)}
    boxed = world.in_boxes(points, placed)
    return {"all": row(outside), "outside boxes": row(outside & ~boxed),
            "in boxes, outside solids": row(outside & boxed), "inside solids": row(~outside)}
