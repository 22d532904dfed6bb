"""Coverage and accuracy of a reconstructed object mesh against the true shape."""
import numpy as np
from scipy.spatial import cKDTree

from meshes import Mesh


def compare(truth, vertices_L, faces, points, visible, voxel_m):
    """Measures of a mesh in the true body frame against samples of the true surface.

    truth: the true Mesh; points: samples of it; visible: those that were ever in view.
    r_cov                share of the samples with a vertex within voxel / 2 * sqrt(3) (the paper's)
    r_cov_surface        the same, measured to the triangles
    ..._visible          the same over the visible samples
    rmse_m               root mean square distance of the vertices to the true surface (the paper's)
    """
    reach = voxel_m / 2 * np.sqrt(3)
    error = truth.nearest(vertices_L)[0] if len(vertices_L) else np.zeros(0)
    some = len(error) > 0
    result = {"vertices": len(vertices_L), "faces": len(faces), "visible_share": float(visible.mean()),
              "rmse_m": float(np.sqrt(np.mean(error**2))) if some else None,
              "median_m": float(np.median(error)) if some else None,
              "p95_m": float(np.percentile(error, 95)) if some else None,
              "max_m": float(error.max()) if some else None}
    near = cKDTree(vertices_L).query(points)[0] if some else np.full(len(points), np.inf)
    to_surface = Mesh(vertices_L, faces).nearest(points)[0] if len(faces) else np.full(len(points), np.inf)
    for name, distance in (("r_cov", near), ("r_cov_surface", to_surface)):
        covered = distance < reach
        result[name] = float(covered.mean())
        result[name + "_visible"] = float(covered[visible].mean()) if visible.any() else None
    return result


def evaluate(world, j, vertices_L, faces, frame=None, samples=50000):
    """compare() of a mesh of object j, with what was in view up to a frame (default: the last)."""
    frame = world.sequence.frame_count - 1 if frame is None else frame
    points = world.objects[j].sample(samples)
    visible = world.visible(j, points, range(frame + 1))
    return {"object": j, "frame": frame,
            **compare(world.objects[j], vertices_L, faces, points, visible, world.sequence.voxel_m)}
