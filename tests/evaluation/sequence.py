"""Reads sequence folders."""
import csv
import json
import pathlib

import cv2
import numpy as np

import ply
import poses


class Sequence:
    """A recording, with its ground truth where it has one.

    motions, object_poses: {object id: {frame: 4x4}}; object_poses are the exact ones of a simulated
    sequence (with future frames), or the annotated ones of a recording.
    """

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.name = self.folder.resolve().name
        self.info = json.loads((self.folder / "sequence.json").read_text())
        self.sensor = dict(self.info["sensor"])
        self.is_camera = self.sensor["type"] == "depth_camera"
        self.voxel_m = self.info.get("voxel_size_m") or (0.1 if self.is_camera else 0.2)
        self.sensor.setdefault("max_range_m", 25.0 if self.is_camera else 40.0)
        rows = np.loadtxt(self.folder / "trajectory.tum", ndmin=2)
        self.frame_count = min(self.info.get("frame_count", len(rows)), len(rows))
        self.rate_hz = (self.info.get("rate_hz") or self.info.get("frame_rate_hz") or
                        (1 / np.median(np.diff(rows[:, 0])) if len(rows) > 1 else 10.0))
        self.times_s, self.sensor_poses = rows[:, 0], [poses.from_tq(r[1:]) for r in rows]
        self.motions = self._poses("object_motions.csv")
        self.exact = (self.folder / "gt" / "object_poses.csv").exists()
        self.object_poses = self._poses("gt/object_poses.csv" if self.exact else "object_poses.csv")
        self._rays = None

    def frames(self):
        """Those that arrive: all."""
        return list(range(self.frame_count))

    def motions_of(self, frame):
        """[(object id, frame at which the motion starts or None for the one before, H_W)] into a frame."""
        return [(j, None, known[frame]) for j, known in sorted(self.motions.items()) if frame in known]

    def _poses(self, name):
        found = {}
        if (self.folder / name).exists():
            with open(self.folder / name, newline="") as f:
                for row in csv.DictReader(f):
                    tq = [float(row[c]) for c in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")]
                    found.setdefault(int(row["object_id"]), {})[int(row["frame"])] = poses.from_tq(
                        np.array(tq))
        return found

    def box_sizes(self):
        """{object id: [length, width, height]} of the annotated movers of a recording."""
        if not (self.folder / "objects.csv").exists():
            return {}
        with open(self.folder / "objects.csv", newline="") as f:
            return {int(r["object_id"]): np.array([float(r[c]) for c in ("length", "width", "height")])
                    for r in csv.DictReader(f) if r.get("moving", "1") == "1"}

    def mesh(self, name):
        """'static' or an object id."""
        file = "static.ply" if name == "static" else f"objects/{name}.ply"
        return ply.read_mesh(self.folder / "gt" / file)

    def scan_path(self, kind, frame):
        return self.folder / kind / f"{frame:06d}.{'ply' if kind == 'cloud' else 'png'}"

    def rays(self):
        """Directions with z = 1 of all pixels [height, width, 3]."""
        if self._rays is None:
            s = self.sensor
            v, u = np.mgrid[:s["height"], :s["width"]]
            self._rays = np.dstack([(u - s["cx"]) / s["fx"], (v - s["cy"]) / s["fy"], np.ones(u.shape)])
        return self._rays

    def images(self, frame):
        """Depth in steps of depth_scale_m and labels, as stored."""
        depth = cv2.imread(str(self.scan_path("depth", frame)), cv2.IMREAD_UNCHANGED)
        path = self.scan_path("label", frame)
        label = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else np.zeros_like(depth)
        return depth, label

    def scan(self, frame):
        """Points in the sensor frame [n, 3] and their labels [n]."""
        if not self.is_camera:
            return ply.read_cloud(self.scan_path("cloud", frame))
        return self.points_of(*self.images(frame))

    def points_of(self, depth, label):
        """As scan, of images as stored."""
        seen = depth > 0
        points = depth[seen, None] * self.sensor["depth_scale_m"] * self.rays()[seen]
        keep = points[:, 2] <= self.sensor["max_range_m"]
        return points[keep], label[seen][keep].astype(int)

    def in_view(self, points_X):
        """Whether points in the sensor frame lie in its field of view and range."""
        s, (x, y, z) = self.sensor, points_X.T
        if self.is_camera:
            with np.errstate(divide="ignore", invalid="ignore"):
                u, v = x / z * s["fx"] + s["cx"], y / z * s["fy"] + s["cy"]
            return ((z > 0) & (z <= s["max_range_m"]) & (u > -.5) & (v > -.5) &
                    (u < s["width"] - .5) & (v < s["height"] - .5))
        distance = np.linalg.norm(points_X, axis=1)
        elevation = np.degrees(np.arcsin(np.clip(z / np.maximum(distance, 1e-9), -1, 1)))
        low, high = s.get("vertical_fov_deg", (-90.0, 90.0))
        return ((distance <= s["max_range_m"]) & (elevation >= s.get("elevation_min_deg", low)) &
                (elevation <= s.get("elevation_max_deg", high)))
