"""The exact world of a simulated sequence: signed distances at a frame, and what was in view."""
import copy

import numpy as np

import poses
from meshes import Mesh


class World:
    """Static scene and movers at their true poses.

    Outside of solids the distance is exact; inside overlapping solids the sign is right and the
    distance may be that to a buried face.
    """

    def __init__(self, sequence):
        self.sequence = sequence
        self.static = Mesh(*sequence.mesh("static"))
        self.objects = {j: Mesh(*sequence.mesh(j)) for j in sequence.object_poses}

    def of(self, sequence):
        """The same world, as a shortened or degraded recording of it saw it."""
        other = copy.copy(self)
        other.sequence = sequence
        return other

    def pose(self, j, frame):
        """T_W_L at a frame, also between two; future frames included."""
        known, k = self.sequence.object_poses[j], int(np.floor(frame + 1e-9))
        share = frame - k
        return known[k] if share < 1e-9 else poses.between(known[k], known[k + 1], share)

    def carried(self, j, frame, seconds):
        """T_W_L `seconds` after a frame, along the true screw motion into that frame (constant twist)."""
        known = self.sequence.object_poses[j]
        H = known[frame] @ poses.inverse(known[frame - 1]) if frame - 1 in known else np.eye(4)
        return poses.power(H, seconds * self.sequence.rate_hz) @ known[frame]

    def in_boxes(self, points, placed):
        """Whether world points lie in the box around any object; placed: {object id: T_W_L}."""
        found = np.zeros(len(points), bool)
        for j, T in placed.items():
            local, v = poses.apply(poses.inverse(T), points), self.objects[j].vertices
            found |= ((local >= v.min(0)) & (local <= v.max(0))).all(1)
        return found

    def distance(self, points, frame=0, objects=None, static=True, placed=None):
        """Signed distance, nearest surface point and its owner (0: static) of world points.

        objects: ids to include (None: all). placed: {object id: T_W_L} instead of the poses at `frame`.
        """
        points = np.asarray(points, float).reshape(-1, 3)
        best = np.full(len(points), np.inf)
        nearest, owner = np.zeros((len(points), 3)), np.zeros(len(points), int)
        bodies = [(0, self.static, np.eye(4))] if static else []
        bodies += [(j, self.objects[j], self.pose(j, frame) if placed is None else placed[j])
                   for j in (self.objects if objects is None else objects)]
        for j, mesh, T in bodies:
            local = poses.apply(poses.inverse(T), points)
            d, near, _ = mesh.nearest(local)
            d = np.where(mesh.inside(local), -d, d)
            closer = d < best
            best[closer], owner[closer] = d[closer], j
            nearest[closer] = poses.apply(T, near[closer])
        return best, nearest, owner

    def visible(self, j, points_L, frames):
        """Whether body points of object j were in view and unhidden in any of the frames."""
        seen = np.zeros(len(points_L), bool)
        for k in frames:
            T, X = self.pose(j, k), self.sequence.sensor_poses[k]
            todo = np.flatnonzero(~seen)
            todo = todo[self.sequence.in_view(poses.apply(poses.inverse(X) @ T, points_L[todo]))]
            for i, mesh in [(j, self.objects[j]), (0, self.static), *self.objects.items()]:
                if len(todo) == 0:
                    break
                to_body = (poses.inverse(self.pose(i, k)) if i else np.eye(4))
                eye = poses.apply(to_body, X[:3, 3])
                todo = todo[~mesh.blocked(eye, poses.apply(to_body @ T, points_L[todo]))]
            seen[todo] = True
        return seen
