#!/usr/bin/env python3
"""Draws the results of a demo run: demo_pictures.py OUT

overview.png: the slices now and ahead; meshes.png: the static map and one object, shaded.
"""
import pathlib
import sys

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection

MOST_TRIANGLES = 150000


def read_mesh(path):
    """Vertices and triangles of a binary PLY with float x y z first and triangles only."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    counts, row, kind = {}, {"vertex": [], "face": []}, None
    for words in (line.split() for line in data[:end].decode().splitlines()):
        if words[0] == "element":
            kind = words[1]
            counts[kind] = int(words[2])
        elif words[0] == "property" and words[1] != "list":
            sizes = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4",
                     "ushort": "<u2", "short": "<i2", "char": "i1"}
            row[kind].append((words[-1], sizes[words[1]]))
    vertices = np.frombuffer(data, np.dtype(row["vertex"]), counts["vertex"], end)
    faces = np.frombuffer(data, np.dtype([("n", "u1"), ("v", "<i4", 3)] + row["face"]),
                          counts.get("face", 0), end + vertices.nbytes)
    return np.stack([vertices[a] for a in "xyz"], -1).astype(float), faces["v"]


def draw_mesh(axis, vertices, faces, azimuth_deg, elevation_deg, title):
    """Orthographic, shaded, far triangles first."""
    axis.set_title(title, fontsize=10)
    axis.set_aspect("equal")
    axis.axis("off")
    if len(faces) == 0:
        return
    faces = faces[::len(faces) // MOST_TRIANGLES + 1]
    a, e = np.radians([azimuth_deg, elevation_deg])
    to_eye = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0])
    up = np.cross(to_eye, right)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = np.abs(normals @ (to_eye + [0, 0, .6]) / np.linalg.norm(to_eye + [0, 0, .6]))
    height = corners[..., 2].mean(1)
    low, high = np.percentile(height, [1, 99])
    colour = plt.cm.viridis(np.clip((height - low) / max(high - low, 1e-9), 0, 1))[:, :3]
    colour *= (.35 + .65 * light)[:, None]
    order = np.argsort(corners.mean(1) @ to_eye)
    flat = np.stack([corners @ right, corners @ up], -1)[order]
    axis.add_collection(PolyCollection(flat, facecolors=colour[order], edgecolors=colour[order],
                                       linewidths=.15))
    axis.autoscale_view()


def main():
    out = pathlib.Path(sys.argv[1])
    slices = sorted(out.glob("slice_*.png"), key=lambda p: float(p.stem.split("_")[1]))
    figure, axes = plt.subplots(2, (len(slices) + 1) // 2, figsize=(14, 14), squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, path in zip(axes.flat, slices):
        ahead = float(path.stem.split("_")[1])
        axis.imshow(plt.imread(path))
        axis.set_title("now" if ahead == 0 else f"{ahead:g} s ahead", fontsize=12)
    figure.tight_layout()
    figure.savefig(out / "overview.png", dpi=90)

    objects = sorted(out.glob("object_*.ply"))[:1]
    figure, axes = plt.subplots(1, 1 + len(objects), figsize=(10 + 6 * len(objects), 8),
                                squeeze=False, width_ratios=[2] + [1] * len(objects))
    draw_mesh(axes[0, 0], *read_mesh(out / "map.ply"), -60, 40, "the static map")
    for axis, path in zip(axes[0, 1:], objects):
        draw_mesh(axis, *read_mesh(path), -60, 30, f"object {path.stem.split('_')[1]}")
    figure.tight_layout()
    figure.savefig(out / "meshes.png", dpi=90)


if __name__ == "__main__":
    main()
