#!/usr/bin/env python3
"""Makes a sequence folder of a recording in the format of the TUM RGB-D benchmark:

    tum_rgbd.py RECORDING OUT [--voxel-m 0.05] [--max-range-m 4] [--every 1] [--intrinsics FX FY CX CY]

RECORDING holds depth.txt (time, file), groundtruth.txt (time tx ty tz qx qy qz qw: the camera in the
world) and 16 bit depth images, 5000 steps a metre, 0 = no return. Each image takes the pose
interpolated at its time; images outside of the known poses, or in gaps of more than 0.1 s, are left
out. The format knows no objects: everything is static.
"""
import argparse
import json
import pathlib
import shutil

import cv2
import numpy as np

import poses

STEPS_PER_M = 5000
LONGEST_GAP_S = 0.1


def _rows(path):
    return [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def pose_at(times_s, known, time_s):
    """The interpolated pose at a time; None where the neighbouring ones are too far apart."""
    i = int(np.searchsorted(times_s, time_s))
    if i < len(times_s) and times_s[i] == time_s:
        return known[i]
    if i == 0 or i == len(times_s) or times_s[i] - times_s[i - 1] > LONGEST_GAP_S:
        return None
    return poses.between(known[i - 1], known[i], (time_s - times_s[i - 1]) / (times_s[i] - times_s[i - 1]))


def convert(recording, out, voxel_m=0.05, max_range_m=4.0, every=1, intrinsics=(525.0, 525.0, 319.5, 239.5)):
    """Writes the folder `out`, which must not exist; returns the number of frames."""
    truth = np.array([row[:8] for row in _rows(recording / "groundtruth.txt")], float)
    known = [poses.from_tq(row[1:]) for row in truth]
    (out / "depth").mkdir(parents=True)
    lines, size, times = [], None, []
    for time, name in (row[:2] for row in _rows(recording / "depth.txt")[::every]):
        T = pose_at(truth[:, 0], known, float(time))
        if T is None:
            continue
        image = cv2.imread(str(recording / name), cv2.IMREAD_UNCHANGED)
        if image is None or image.dtype != np.uint16 or image.ndim != 2:
            raise ValueError(f"{recording / name}: expected a 16 bit image of one channel")
        size = image.shape
        shutil.copyfile(recording / name, out / "depth" / f"{len(lines):06d}.png")
        lines.append(" ".join([time] + [f"{v:.9f}" for v in poses.to_tq(T)]))
        times.append(float(time))
    if len(lines) < 2:
        raise ValueError(f"{recording}: fewer than two depth images have a pose")
    (out / "trajectory.tum").write_text("\n".join(lines) + "\n")
    fx, fy, cx, cy = intrinsics
    sensor = {"type": "depth_camera", "width": size[1], "height": size[0], "fx": fx, "fy": fy, "cx": cx, "cy": cy,
              "depth_scale_m": 1 / STEPS_PER_M, "max_range_m": max_range_m}
    info = {"name": recording.name, "source": "TUM RGB-D benchmark", "licence": "CC BY 4.0", "sensor": sensor,
            "frame_count": len(lines), "voxel_size_m": voxel_m, "rate_hz": 1 / float(np.median(np.diff(times)))}
    (out / "sequence.json").write_text(json.dumps(info, indent=1) + "\n")
    return len(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--voxel-m", type=float, default=0.05)
    parser.add_argument("--max-range-m", type=float, default=4.0)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--intrinsics", type=float, nargs=4, default=(525.0, 525.0, 319.5, 239.5))
    a = parser.parse_args()
    print(f"{convert(a.recording, a.out, a.voxel_m, a.max_range_m, a.every, a.intrinsics)} frames: {a.out}")


if __name__ == "__main__":
    main()
