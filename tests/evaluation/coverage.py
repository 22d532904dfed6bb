"""Coverage and accuracy of every object's mesh, frame by frame (the paper's Fig. 5 and Table I)."""
import numpy as np

import object_mesh
import poses


class CoverageCurves:
    """Fed with the meshes of a growing map. One row an object and frame:

    frame, object, frames_in_view (so far), vertices, visible_share, rmse_m, r_cov, r_cov_visible,
    r_cov_surface, r_cov_surface_visible (see object_mesh).
    """

    def __init__(self, world, samples, every=1):
        self._world, self._every = world, every
        self._points = {j: mesh.sample(samples) for j, mesh in world.objects.items()}
        self._visible = {j: np.zeros(samples, bool) for j in world.objects}
        self._in_view = {j: 0 for j in world.objects}
        self.rows = []

    def after(self, frame, labels, mesh_of):
        """A frame was integrated. labels: those in it; mesh_of(object id) -> vertices in W, triangles; it
        raises RuntimeError where the map has no such object."""
        world = self._world
        last = frame == world.sequence.frame_count - 1
        for j in map(int, np.unique(labels)):
            if j in self._in_view:
                self._in_view[j] += 1
        for j, points in self._points.items():
            hidden = np.flatnonzero(~self._visible[j])
            self._visible[j][hidden[world.visible(j, points[hidden], [frame])]] = True
            if self._in_view[j] == 0 or (frame % self._every and not last):
                continue
            row = {"frame": frame, "object": j, "frames_in_view": self._in_view[j]}
            try:
                vertices, faces = mesh_of(j)
                vertices = poses.apply(poses.inverse(world.pose(j, frame)), vertices)
                row.update(object_mesh.compare(world.objects[j], vertices, faces, points, self._visible[j],
                                               world.sequence.voxel_m))
            except RuntimeError as error:
                row["error"] = str(error)
            self.rows.append(row)

    def final(self):
        """{object id: its last row}."""
        return {row["object"]: row for row in self.rows}
