"""What is measured of one recording, with the truth worked out once for all the maps made of it."""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import field_error
import free_space
import ghosts
import object_mesh
import occupancy
import poses
from mapping import MAX_DISTANCE_M

HORIZONS_S = (0.0, 0.5, 1.0, 2.0)
RETURNS_OF_LAST_FRAMES = 10


@dataclass
class Effort:
    """How much is asked."""
    points: int = 40000       # of distances
    samples: int = 20000      # of each object's surface
    every: int = 1            # frames of a coverage curve
    voxels: int = 200000      # of truly occupied space
    scans: int = 1            # every n-th is kept as observed surface

    @classmethod
    def quick(cls):
        return cls(points=10000, samples=5000, every=5, voxels=30000, scans=3)


class Measures:
    """All measures compare a Mapping at its last frame with the truth of `sequence`."""

    def __init__(self, sequence, world, effort):
        self.sequence, self.world, self.effort = sequence, world, effort
        self.last = sequence.frame_count - 1

    @cached_property
    def observed(self):
        return field_error.ObservedSurface(self.world, self.effort.scans)

    @cached_property
    def open_points(self):
        return field_error.points_in_the_open(self.sequence, self.effort.points)

    @cached_property
    def movers(self):
        return field_error.movers_in_view(self.world)

    @cached_property
    def occupied(self):
        return occupancy.static_voxels(self.world, self.effort.voxels)

    @cached_property
    def _occupied_observed(self):
        return self.observed.static_near(self.occupied, self.sequence.voxel_m / 2)

    @cached_property
    def slab(self):
        return free_space.FreeSpace(self.world)

    @cached_property
    def swept(self):
        return ghosts.swept_space(self.sequence, self.world)

    @property
    def has_swept_space(self):
        """Whether anything that moved is known: true shapes, or annotated boxes."""
        if self.world:
            return bool(self.world.objects)
        return bool(set(self.sequence.box_sizes()) & set(self.sequence.object_poses))

    @cached_property
    def frames_in_view(self):
        """{object id: frames with a labelled return}."""
        seen = {}
        for k in range(self.sequence.frame_count):
            for j in map(int, np.unique(self.sequence.scan(k)[1])):
                if j:
                    seen[j] = seen.get(j, 0) + 1
        return seen

    @cached_property
    def _surfaces(self):
        """{object id: samples of its true surface, and which of them were ever in view}."""
        found = {}
        for j in sorted(set(self.frames_in_view) & set(self.world.objects)):
            points = self.world.objects[j].sample(self.effort.samples)
            found[j] = points, self.world.visible(j, points, range(self.last + 1))
        return found

    def meshes(self, mapping):
        """Rows as CoverageCurves gives them, for the last frame alone."""
        rows = []
        for j, (points, visible) in self._surfaces.items():
            row = {"object": j, "frame": self.last, "frames_in_view": self.frames_in_view[j]}
            try:
                vertices, faces = mapping.mesh(j)
                vertices = poses.apply(poses.inverse(self.world.pose(j, self.last)), vertices)
                row.update(object_mesh.compare(self.world.objects[j], vertices, faces, points, visible,
                                               self.sequence.voxel_m))
            except RuntimeError as error:
                row["error"] = str(error)
            rows.append(row)
        return rows

    def static_distances(self, mapping):
        return field_error.evaluate(self.world, self.observed, self.open_points, mapping.answer(static_only=True),
                                    MAX_DISTANCE_M)["open"]

    def _placed(self, horizon_s, constant_twist=False):
        """{object id: T_W_L} at a horizon; None where the truth does not reach so far."""
        frame = self.last + horizon_s * self.sequence.rate_hz
        if constant_twist:
            return {j: self.world.carried(j, self.last, horizon_s) for j in self.world.objects}
        if any(frame > max(known) for known in self.sequence.object_poses.values()):
            return None
        return {j: self.world.pose(j, frame) for j in self.world.objects}

    def near_objects(self, mapping, horizons_s=HORIZONS_S):
        """{horizon: {truth: {region: statistics}}}; truths: the objects' true motion, and at constant twist."""
        result = {}
        for h in horizons_s:
            rows = {}
            for truth, twist in (("true motion", False), ("constant twist", True)):
                placed = self._placed(h, twist)
                if placed is None or not self.movers or (h == 0 and twist):
                    continue
                points = field_error.points_near_objects(self.world, self.movers, placed, self.effort.points // 2)
                rows[truth] = field_error.evaluate(self.world, self.observed, points, mapping.answer(horizon_s=h),
                                                   MAX_DISTANCE_M, placed)
                if h == 0:
                    weighted = field_error.evaluate(self.world, self.observed, points, mapping.answer(weighted=True),
                                                    MAX_DISTANCE_M, placed)
                    rows["weighted"] = {"all": weighted["all"]}
            if rows:
                result[f"{h:g}"] = rows
        return result

    def truly_occupied(self, mapping):
        """Judged by the static map for the static scene, by the whole map for objects with 10 frames in view.

        observed: of the static voxels, those with a return within half a voxel of the middle.
        """
        static = mapping.answer(static_only=True)
        rows = {"static": occupancy.judge(self.occupied, static),
                "static, observed": occupancy.judge(self.occupied[self._occupied_observed], static)}
        centres = [occupancy.object_voxels(self.world, j, self.last) for j in self.movers
                   if self.frames_in_view.get(j, 0) >= 10]
        centres = np.concatenate(centres) if centres else np.zeros((0, 3))
        if len(centres):
            rows["objects"] = occupancy.judge(centres, mapping.answer())
        return rows

    def free_space(self, mapping):
        def states(points):
            got = mapping.answer(static_only=True)(points)
            return got.states, got.low_confidence
        return self.slab.evaluate(states)

    def ghosts(self, mapping):
        counts, where = ghosts.evaluate(self.swept, lambda p: mapping.answer(static_only=True)(p).states)
        counts["ghosts_at"] = np.round(where[:20], 3).tolist()
        return counts

    def returns(self, mapping):
        """Where the last frames saw surface, as the mapping's own poses say: distances ought to be zero."""
        points = []
        for k in mapping.sequence.frames()[-RETURNS_OF_LAST_FRAMES:]:
            p, labels = mapping.sequence.scan(k)
            reach = np.linalg.norm(p, axis=1)
            p = p[(labels == 0) & (reach < self.sequence.sensor["max_range_m"] - self.sequence.voxel_m)]
            points.append(poses.apply(mapping.sequence.sensor_poses[k], p))
        points = np.concatenate(points)
        rng = np.random.default_rng(0)
        points = points[rng.permutation(len(points))[:self.effort.points]]
        got = mapping.answer(static_only=True)(points)
        row = field_error.statistics(got.distances, self.sequence.voxel_m)
        free = got.states == 1
        row["free_high_share"] = float((free & ~got.low_confidence).mean())
        row["free_low_share"] = float((free & got.low_confidence).mean())
        row["unknown"] = float((got.states == 0).mean())
        return row
