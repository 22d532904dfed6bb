"""Writes a copy of a sequence whose labels a real front end could have got wrong."""
import csv
import json
import os
import pathlib
import shutil

import cv2
import numpy as np
from scipy.spatial import cKDTree

import ply


def _shrink_image(label, pixels):
    """Labels stay where the whole square around a pixel has them."""
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    # Equal minimum and maximum over the square, borders repeated: one label only.
    low = cv2.erode(label, kernel, borderType=cv2.BORDER_REPLICATE)
    high = cv2.dilate(label, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.where(low == high, label, 0).astype(label.dtype)


def _shrink_cloud(points, labels, pixels, sensor):
    """The same in angles: returns within `pixels` beams and columns of another label turn static."""
    marked = np.flatnonzero(labels)
    if len(marked) == 0:
        return labels
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    view = np.radians(sensor.get("horizontal_fov_deg", 360.0))
    column = 2 * np.pi / sensor["columns"] if "columns" in sensor else np.radians(0.17)
    if "elevation_min_deg" in sensor:
        span = np.radians(sensor["elevation_max_deg"] - sensor["elevation_min_deg"])
    else:
        span = np.ptp(np.radians(sensor["vertical_fov_deg"]))
    grid = np.column_stack([azimuth / column, elevation / (span / (sensor["beams"] - 1))])
    if view >= 2 * np.pi - 1e-6:  # the seam behind the sensor
        turn = 2 * np.pi / column
        grid = np.concatenate([grid, grid + [turn, 0], grid - [turn, 0]])
    tiled = np.tile(labels, len(grid) // len(labels))
    out = labels.copy()
    for j in np.unique(labels[marked]):
        own = np.flatnonzero(labels == j)
        others = cKDTree(grid[tiled != j])
        near = others.query(grid[own], p=np.inf, distance_upper_bound=pixels + .5)[0]
        out[own[np.isfinite(near)]] = 0
    return out


def degrade(sequence, target, shrink_px=0, late_frames=0):
    """Writes `sequence` to the folder `target` with labels `shrink_px` pixels too small at every border,
    and objects unlabelled in the first `late_frames` frames in which they have labels.

    Files that stay the same are linked. The motions of a late object start after its first label.
    """
    target = pathlib.Path(target)
    target.mkdir(parents=True)
    kind = "label" if sequence.is_camera else "cloud"
    for path in sequence.folder.iterdir():
        if path.name not in (kind, "object_motions.csv", "sequence.json"):
            os.symlink(path.resolve(), target / path.name)
    info = dict(sequence.info, label_shrink_px=shrink_px, late_label_frames=late_frames)
    (target / "sequence.json").write_text(json.dumps(info, indent=1) + "\n")
    (target / kind).mkdir()
    frames_seen, first_labelled = {}, {}
    for k in range(sequence.frame_count):
        source, path = sequence.scan_path(kind, k), target / kind / sequence.scan_path(kind, k).name
        if not source.exists():
            continue
        if sequence.is_camera:
            labels = cv2.imread(str(source), cv2.IMREAD_UNCHANGED)
        else:
            points, labels = ply.read_cloud(source)
        present = [int(j) for j in np.unique(labels) if j]
        for j in present:
            frames_seen[j] = frames_seen.get(j, 0) + 1
        late = [j for j in present if frames_seen[j] <= late_frames]
        if shrink_px:
            labels = (_shrink_image(labels, shrink_px) if sequence.is_camera else
                      _shrink_cloud(points, labels, shrink_px, sequence.sensor))
        labels = np.where(np.isin(labels, late), 0, labels)
        for j in present:
            if j not in late:
                first_labelled.setdefault(j, k)
        if sequence.is_camera:
            cv2.imwrite(str(path), labels.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 3])
        else:
            ply.write_cloud(path, points, labels)
    _write_motions(sequence, target, first_labelled if late_frames else None)
    return target


def _write_motions(sequence, target, first_labelled):
    source = sequence.folder / "object_motions.csv"
    if not source.exists():
        return
    if first_labelled is None:
        shutil.copyfile(source, target / source.name)
        return
    with open(source, newline="") as f, open(target / source.name, "w", newline="") as out:
        rows = csv.reader(f)
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(next(rows))
        for row in rows:
            first = first_labelled.get(int(row[1]))
            if first is not None and int(row[0]) > first:
                writer.writerow(row)
