"""Free space in a slab around the sensor's height against the exact one (the paper's Table II)."""
import numpy as np

import poses
from meshes import VoxelGrid

FINEST_M = 1e-3


def touches(mesh, centres, half_m):
    """Whether cubes contain surface. Spheres in and around each cube decide; what they leave open is
    split in eight, and counts as touching once it is as small as FINEST_M."""
    distance = mesh.nearest(centres)[0]
    touch = distance <= half_m
    doubtful = np.flatnonzero(~touch & (distance <= half_m * np.sqrt(3)))
    if half_m < FINEST_M:
        touch[doubtful] = True
    elif len(doubtful):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half_m / 2
        for part in np.array_split(doubtful, len(doubtful) // 20000 + 1):
            children = (centres[part, None] + corners).reshape(-1, 3)
            touch[part] = touches(mesh, children, half_m / 2).reshape(-1, 8).any(1)
    return touch


class FreeSpace:
    """True states of the voxels of a slab: 2 contains static surface, 1 seen free, 0 neither.

    Seen free: the centre is in view and in range of some frame, with a clear line past the static
    scene (what moves is ignored).
    """

    def __init__(self, world, thickness_m=1.0):
        sequence = world.sequence
        v, reach = sequence.voxel_m, sequence.sensor["max_range_m"]
        eyes = np.array([X[:3, 3] for X in sequence.sensor_poses])
        floor = np.rint(eyes[:, 2].mean() / v - thickness_m / v / 2) * v
        low = np.r_[eyes[:, :2].min(0) - reach, floor]
        high = np.r_[eyes[:, :2].max(0) + reach, floor + thickness_m]
        grid = VoxelGrid(low, high, v)
        self.centres = grid.centres(np.indices(grid.size).reshape(3, -1).T)
        occupied = touches(world.static, self.centres, v / 2)
        seen, open_ = np.zeros(len(self.centres), bool), np.flatnonzero(~occupied)
        for X in sequence.sensor_poses:
            todo = open_[~seen[open_]]
            todo = todo[sequence.in_view(poses.apply(poses.inverse(X), self.centres[todo]))]
            seen[todo[~world.static.blocked(X[:3, 3], self.centres[todo])]] = True
        self.state = np.where(occupied, 2, np.where(seen, 1, 0))

    def evaluate(self, query_static):
        """query_static(points) -> (states, low confidence flags). TP: free in both. FN: free, called
        occupied. FP: contains surface, called free."""
        known = self.state > 0
        truth = self.state[known]
        states, low = query_static(self.centres[known])
        free, surface = truth == 1, truth == 2
        called_free = states == 1
        total = max(int(free.sum()), 1)
        result = {"truth_free": int(free.sum()), "truth_occupied": int(surface.sum()),
                  "TP": int((free & called_free).sum()), "TP_high": int((free & called_free & ~low).sum()),
                  "FN": int((free & (states == 2)).sum()),
                  "FP": int((surface & called_free).sum()),
                  "FP_high": int((surface & called_free & ~low).sum()),
                  "unobserved": int((free & (states == 0)).sum())}
        for name in ("TP", "TP_high", "FN", "FP", "FP_high"):
            result[name + "_share"] = result[name] / total
        return result
