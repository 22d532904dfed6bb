"""Exact queries on triangle meshes, and counting of rays (truth/mesh_queries.cc by ctypes)."""
import ctypes
import os
import pathlib

import numpy as np

_LIBRARY = os.environ.get("CLEARANCE_TRUTH_LIBRARY") or str(
    pathlib.Path(__file__).resolve().parents[2] / "build/lib/libclearance_truth.so")
_lib = ctypes.CDLL(_LIBRARY)
_lib.truth_mesh_new.restype = ctypes.c_void_p


def _array(a, dtype=np.float64):
    return np.ascontiguousarray(a, dtype)


def _at(a):
    return a.ctypes.data_as(ctypes.c_void_p)


class Mesh:
    """Rigid triangles in a frame of their own."""

    def __init__(self, vertices, faces):
        self.vertices = _array(vertices).reshape(-1, 3)
        self.faces = _array(faces, np.uint32).reshape(-1, 3)
        self._closed = None
        self._mesh = ctypes.c_void_p(_lib.truth_mesh_new(
            _at(self.vertices), ctypes.c_size_t(len(self.vertices)), _at(self.faces),
            ctypes.c_size_t(len(self.faces))))

    def __del__(self):
        if getattr(self, "_mesh", None):
            _lib.truth_mesh_free(self._mesh)

    def _is_closed(self):
        """Whether every edge, of vertices at one place, belongs to two triangles or more."""
        if len(self.faces) == 0:
            return False
        _, place = np.unique(np.round(self.vertices, 5), axis=0, return_inverse=True)
        f = place.reshape(-1)[self.faces]
        f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), 1)
        return bool((np.unique(edges, axis=0, return_counts=True)[1] > 1).all())

    @property
    def closed(self):
        """An open mesh has no certain inside: its `inside` is a majority of more rays, some of which escape."""
        if self._closed is None:
            self._closed = self._is_closed()
        return self._closed

    def normals(self):
        """Unit normals of the triangles."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        n = np.cross(b - a, c - a)
        return n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)

    def nearest(self, points):
        """Unsigned distance [n], nearest point [n, 3] and its triangle [n]."""
        p = _array(points).reshape(-1, 3)
        distance, near, face = np.empty(len(p)), np.empty((len(p), 3)), np.empty(len(p), np.int32)
        _lib.truth_nearest(self._mesh, _at(p), ctypes.c_size_t(len(p)), _at(distance), _at(near), _at(face))
        return distance, near, face

    def inside(self, points):
        """Whether points lie in any of the closed surfaces: the majority of three directions (open: nine)."""
        p = _array(points).reshape(-1, 3)
        votes, directions = np.zeros(len(p), int), 3 if self.closed else 9
        for direction in np.random.default_rng(5).normal(size=(directions, 3)):
            inside, d = np.empty(len(p), np.uint8), _array(direction)
            _lib.truth_inside(self._mesh, _at(p), ctypes.c_size_t(len(p)), _at(d), _at(inside))
            votes += inside
        return 2 * votes > directions

    def blocked(self, eye, targets, slack_m=1e-4):
        """Whether the mesh hides each target from the eye."""
        e, t = _array(eye), _array(targets).reshape(-1, 3)
        out = np.empty(len(t), np.uint8)
        _lib.truth_blocked(self._mesh, _at(e), _at(t), ctypes.c_size_t(len(t)), ctypes.c_double(slack_m),
                           _at(out))
        return out.astype(bool)

    def sample(self, count, seed=0):
        """Points spread evenly over the outer surface: faces buried in an overlapping solid do not count."""
        rng = np.random.default_rng(seed)
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        normals, found, missing = self.normals(), [], count
        # Faces of an open mesh may point inwards, so that nothing tells what is buried.
        buried = (lambda p: self.inside(p)) if self.closed else (lambda p: np.zeros(len(p), bool))
        while missing > 0:
            f = rng.choice(len(self.faces), 2 * missing + 100, p=area / area.sum())
            u, v = np.sqrt(rng.random(len(f)))[:, None], rng.random(len(f))[:, None]
            p = (1 - u) * a[f] + u * (1 - v) * b[f] + u * v * c[f]
            p = p[~buried(p + 1e-3 * normals[f])][:missing]
            found.append(p)
            missing -= len(p)
        return np.concatenate(found)


class VoxelGrid:
    """A dense box of voxels whose edges lie on multiples of the voxel size."""

    def __init__(self, low, high, voxel_m):
        self.voxel_m = voxel_m
        self.first = np.floor(np.asarray(low) / voxel_m + 1e-9).astype(np.int64)
        self.size = np.maximum(np.ceil(np.asarray(high) / voxel_m - 1e-9).astype(np.int64) - self.first, 1)
        self.origin = self.first * voxel_m

    def index(self, points):
        """Integer cells [n, 3] relative to the grid, and which of them lie in it."""
        cells = np.floor(np.asarray(points) / self.voxel_m).astype(np.int64) - self.first
        return cells, ((cells >= 0) & (cells < self.size)).all(-1)

    def centres(self, cells):
        return (cells + self.first + .5) * self.voxel_m

    def count_rays(self, eye, ends, open_after, frame, counts):
        """Adds to counts the rays through cells with 0 <= open_after < frame (see truth_count_rays)."""
        eye, ends, origin, size = _array(eye), _array(ends), _array(self.origin), _array(self.size, np.int64)
        assert open_after.dtype == np.int32 and counts.dtype == np.uint32
        assert open_after.flags.c_contiguous and counts.flags.c_contiguous
        _lib.truth_count_rays(_at(eye), _at(ends), ctypes.c_size_t(len(ends)), _at(origin),
                              ctypes.c_double(self.voxel_m), _at(size), _at(open_after),
                              ctypes.c_int32(frame), _at(counts))
