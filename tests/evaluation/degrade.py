"""A sequence as a real front end could have got it wrong: noise, labels, lost frames, other poses.

The truth stays that of the sequence that was degraded."""
import copy

import cv2
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import poses


def _square(pixels):
    return np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)


def _shrink_image(label, pixels):
    """Labels stay where the whole square around a pixel has them."""
    # Equal minimum and maximum over the square, borders repeated: one label only.
    low = cv2.erode(label, _square(pixels), borderType=cv2.BORDER_REPLICATE)
    high = cv2.dilate(label, _square(pixels), borderType=cv2.BORDER_REPLICATE)
    return np.where(low == high, label, 0).astype(label.dtype)


def _grow_image(label, pixels):
    """Static pixels within a square of an object take its label; between two the higher wins."""
    high = cv2.dilate(label, _square(pixels), borderType=cv2.BORDER_REPLICATE)
    return np.where(label == 0, high, label).astype(label.dtype)


def _in_pixels(points, sensor):
    """Azimuth and elevation of returns in columns and beams, and the columns of a full turn (0: none)."""
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    column = 2 * np.pi / sensor["columns"] if "columns" in sensor else np.radians(0.17)
    if "elevation_min_deg" in sensor:
        span = np.radians(sensor["elevation_max_deg"] - sensor["elevation_min_deg"])
    else:
        span = np.ptp(np.radians(sensor.get("vertical_fov_deg", (-15.0, 15.0))))
    full = np.radians(sensor.get("horizontal_fov_deg", 360.0)) >= 2 * np.pi - 1e-6
    return (np.column_stack([azimuth / column, elevation / (span / (sensor["beams"] - 1))]),
            2 * np.pi / column if full else 0)


def _near(grid, turn, chosen, pixels):
    """Tree of the chosen returns, across the seam behind the sensor, and the reach to ask it for."""
    own = grid[chosen]
    copies = [own, own + [turn, 0], own - [turn, 0]] if turn else [own]
    return cKDTree(np.concatenate(copies)), dict(p=np.inf, distance_upper_bound=pixels + .5)


def _shrink_cloud(points, labels, pixels, sensor):
    """In angles: returns within `pixels` beams and columns of another label turn static."""
    marked = np.flatnonzero(labels)
    if len(marked) == 0:
        return labels
    grid, turn = _in_pixels(points, sensor)
    out = labels.copy()
    for j in np.unique(labels[marked]):
        if (labels == j).all():
            continue
        tree, how = _near(grid, turn, labels != j, pixels)
        own = np.flatnonzero(labels == j)
        out[own[np.isfinite(tree.query(grid[own], **how)[0])]] = 0
    return out


def _grow_cloud(points, labels, pixels, sensor):
    marked = np.flatnonzero(labels)
    if len(marked) == 0:
        return labels
    grid, turn = _in_pixels(points, sensor)
    tree, how = _near(grid, turn, marked, pixels)
    static = np.flatnonzero(labels == 0)
    distance, index = tree.query(grid[static], **how)
    found = np.isfinite(distance)
    out = labels.copy()
    out[static[found]] = labels[marked[index[found] % len(marked)]]
    return out


class Degraded:
    """Reads like the sequence that it is made of, which must outlive it.

    shrink_px, grow_px   labels end so many pixels (beams and columns) too early or too late
    late_frames          objects stay static in their first frames with labels; motions follow their first label
    depth_sigma_m        standard deviation of each return along its ray (of depth for images)
    motion_sigma_m       of each object motion, per axis; also 0.5 rad/m of it as rotation about the object
    lost_every           every n-th frame never arrives; with bridged_motions those behind it start a frame earlier
    still_is_static      an object that moves less than a centimetre in a frame has no label and no motion in it
    trajectory           a file of other sensor poses, in the sequence's folder
    """

    def __init__(self, sequence, shrink_px=0, grow_px=0, late_frames=0, depth_sigma_m=0.0, motion_sigma_m=0.0,
                 lost_every=0, bridged_motions=False, still_is_static=False, trajectory=None, seed=1):
        self.base = sequence
        self._shrink_px, self._grow_px, self._late_frames = shrink_px, grow_px, late_frames
        self._depth_sigma_m, self._seed = depth_sigma_m, seed
        self._lost_every, self._bridged = lost_every, bridged_motions
        self.motions = copy.copy(sequence.motions)
        self.sensor_poses = sequence.sensor_poses
        if trajectory:
            rows = np.loadtxt(sequence.folder / trajectory, ndmin=2)
            if len(rows) != sequence.frame_count:
                raise ValueError(f"{trajectory}: {len(rows)} poses, expected {sequence.frame_count}")
            self.sensor_poses = [poses.from_tq(r[1:]) for r in rows]
        self._still = {}
        if still_is_static:
            self._forget_still_objects()
        if late_frames:
            self._follow_late_labels()
        if motion_sigma_m:
            self._shake_motions(motion_sigma_m)

    def __getattr__(self, name):
        if name == "base":  # before __init__
            raise AttributeError(name)
        return getattr(self.base, name)

    def frames(self):
        """Those that arrive; the last does."""
        return [k for k in self.base.frames()
                if not self._lost_every or k % self._lost_every != 1 or k == self.frame_count - 1]

    def images(self, frame):
        depth, label = self.base.images(frame)
        label = self._without_hidden(label, frame)
        if self._shrink_px:
            label = _shrink_image(label, self._shrink_px)
        if self._grow_px:
            label = _grow_image(label, self._grow_px)
        if self._depth_sigma_m:
            noise = self._noise(frame, depth.shape) / self.sensor["depth_scale_m"]
            noisy = np.rint(depth + noise)
            depth = np.where((depth > 0) & (noisy > 0) & (noisy < 65536), noisy, 0).astype(np.uint16)
        return depth, label

    def scan(self, frame):
        if self.is_camera:
            depth, label = self.images(frame)
            return self.base.points_of(depth, label)
        points, labels = self.base.scan(frame)
        labels = self._without_hidden(labels, frame)
        if self._shrink_px:
            labels = _shrink_cloud(points, labels, self._shrink_px, self.sensor)
        if self._grow_px:
            labels = _grow_cloud(points, labels, self._grow_px, self.sensor)
        if self._depth_sigma_m:
            reach = np.linalg.norm(points, axis=1)
            points = points * (1 + self._noise(frame, len(points)) / np.maximum(reach, .1))[:, None]
        return points, labels

    def motions_of(self, frame):
        arrived = set(self.frames())
        if frame - 1 in arrived or not self._bridged:
            return [(j, None if frame - 1 in arrived else frame - 1, H) for j, _, H in self._known(frame)]
        # The front end did follow the object through the lost frame.
        found = []
        for j, _, H in self._known(frame):
            before = self.motions[j].get(frame - 1)
            found.append((j, frame - 1, H) if before is None else (j, frame - 2, H @ before))
        return found

    def _known(self, frame):
        return [(j, None, known[frame]) for j, known in sorted(self.motions.items()) if frame in known]

    def _noise(self, frame, shape):
        return np.random.default_rng([self._seed, frame]).normal(0, self._depth_sigma_m, shape)

    def _without_hidden(self, labels, frame):
        hidden = [j for j, frames in self._still.items() if frame in frames]
        if self._late_frames:
            hidden += [j for j, first in self._first_labelled.items() if first is None or frame < first]
        return np.where(np.isin(labels, hidden), 0, labels).astype(labels.dtype) if hidden else labels

    def _forget_still_objects(self):
        for j, known in self.object_poses.items():
            moved = {k: np.linalg.norm(known[k][:3, 3] - known[k - 1][:3, 3]) for k in known if k - 1 in known}
            self._still[j] = {k for k in known if moved.get(k, moved.get(k + 1, 1.0)) < .01}
        self.motions = {j: {k: H for k, H in known.items() if k not in self._still.get(j, ())}
                        for j, known in self.motions.items()}

    def _follow_late_labels(self):
        seen, self._first_labelled = {}, {}
        for k in range(self.frame_count):
            for j in map(int, np.unique(self.base.scan(k)[1])):
                if j:
                    seen[j] = seen.get(j, 0) + 1
                    self._first_labelled.setdefault(j, None)
                    if seen[j] == self._late_frames + 1:
                        self._first_labelled[j] = k
        self.motions = {j: {k: H for k, H in known.items()
                            if self._first_labelled.get(j) is not None and k > self._first_labelled[j]}
                        for j, known in self.motions.items()}

    def _shake_motions(self, sigma_m):
        shaken = {}
        for j, known in self.motions.items():
            shaken[j] = {}
            for k, H in known.items():
                rng = np.random.default_rng([self._seed, j, k])
                turn, shift = rng.normal(0, .5 * sigma_m, 3), rng.normal(0, sigma_m, 3)
                # About the object, where turning it does not shift it.
                centre = self.object_poses[j][k][:3, 3] if k in self.object_poses.get(j, {}) else H[:3, 3]
                E = np.eye(4)
                E[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
                E[:3, 3] = centre - E[:3, :3] @ centre + shift
                shaken[j][k] = E @ H
        self.motions = shaken
