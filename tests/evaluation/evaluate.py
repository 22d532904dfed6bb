#!/usr/bin/env python3
"""Streams recordings into a server, compares its answers with the exact truth and writes the tables.

    evaluate.py --build DIR [--data DIR] [--out DIR] [--quick] [--only NAME ...]

--data: a folder of sequence folders; without it the simulator writes its own scenes. Every recording
with ground truth is measured in all the ways its data allow; recordings with annotated boxes are
searched for ghosts.
"""
import argparse
import json
import pathlib
import re
import subprocess
import tempfile
import time

import numpy as np

import degrade
import field_error
import free_space
import ghosts
import object_mesh
import ply
import poses
import report
from sequence import Sequence
from server import Server
from world import World

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = {"street": 60, "orbit": 200, "cubes": 150, "hall": 80, "crossing": 60, "plane": 24, "box": 24,
          "sphere": 24, "corner": 24, "pole": 24}
QUICK_SCENES = {"street": 25, "cubes": 30, "hall": 20, "crossing": 30, "box": 24, "corner": 24}
HORIZONS_S = (0.0, 0.5, 1.0, 2.0)
MAX_DISTANCE_M = 5.0
LEAST_FRAMES = 10  # objects seen in fewer frames are not judged


def map_id(name):
    return re.sub(r"[^a-z0-9_-]", "-", name.lower()).lstrip("0123456789_-") or "map"


def frames_in_view(sequence):
    """{object id: frames with a labelled return}."""
    seen = {}
    for k in range(sequence.frame_count):
        for j in np.unique(sequence.scan(k)[1]):
            if j:
                seen[int(j)] = seen.get(int(j), 0) + 1
    return seen


class Evaluation:
    def __init__(self, server, scratch, quick):
        self._server, self._scratch, self._quick = server, pathlib.Path(scratch), quick
        self._points = 10000 if quick else 40000

    def run(self, folder):
        """All measures of one recording."""
        sequence = Sequence(folder)
        world = World(sequence) if sequence.exact else None
        name = map_id(sequence.name)
        result = {"frames": sequence.frame_count, "voxel_m": sequence.voxel_m,
                  "ingest": self._server.ingest(name, sequence.folder)}
        if world:
            if world.objects:
                result["objects"] = self._objects(sequence, world, name)
            result.update(self._distances(sequence, world, name))
            if not sequence.is_camera:
                result["free_space"] = self._free_space(world, name)
        if sequence.object_poses and (world is None or world.objects):
            result["ghosts"] = self._ghosts(sequence, world, name)
        self._server.delete(name)
        return result

    def _objects(self, sequence, world, name):
        rows, seen = [], frames_in_view(sequence)
        last, path = sequence.frame_count - 1, self._scratch / "object.ply"
        for j, frames in sorted(seen.items()):
            row = {"object": j, "frames_in_view": frames, "judged": frames >= LEAST_FRAMES}
            try:
                self._server.mesh(name, j, path)
                vertices, faces = ply.read_mesh(path)
                vertices = poses.apply(poses.inverse(world.pose(j, last)), vertices)
                row.update(object_mesh.evaluate(world, j, vertices, faces, last,
                                                10000 if self._quick else 50000))
            except RuntimeError as error:
                row["error"] = str(error)
            rows.append(row)
        return rows

    def _distances(self, sequence, world, name):
        observed = field_error.ObservedSurface(world, every=3 if self._quick else 1)
        points = field_error.points_in_the_open(sequence, self._points)
        last = sequence.frame_count - 1
        result = {"static": field_error.evaluate(
            world, observed, points, lambda p: self._server.query(name, p, static_only=True)[:3], last,
            MAX_DISTANCE_M, moving=False)}
        if not world.objects:
            return result
        result["near_objects"] = {}
        for horizon_s in HORIZONS_S:
            frame = last + horizon_s * sequence.rate_hz
            if frame > max(next(iter(sequence.object_poses.values()))):
                continue
            near = field_error.points_near_objects(world, self._points // 4, 2.0, frame)
            result["near_objects"][f"{horizon_s:g}"] = field_error.evaluate(
                world, observed, near, lambda p: self._server.query(name, p, horizon_s)[:3], frame,
                MAX_DISTANCE_M)
        return result

    def _free_space(self, world, name):
        def states(points):
            _, states, _, low = self._server.query(name, points, static_only=True)
            return states, low
        return free_space.FreeSpace(world).evaluate(states)

    def _ghosts(self, sequence, world, name):
        space = ghosts.swept_space(sequence, world)

        def judge(map_name):
            counts, where = ghosts.evaluate(
                space, lambda p: self._server.query(map_name, p, static_only=True)[1])
            counts["ghosts_at"] = np.round(where[:20], 3).tolist()
            return counts
        result = {"labels as recorded": judge(name)}
        variants = {} if self._quick else {"labels 3 px too small": {"shrink_px": 3},
                                           "labels 10 frames late": {"late_frames": 10}}
        for title, how in variants.items():
            folder = self._scratch / f"{sequence.name}-degraded-{'-'.join(how)}"
            degrade.degrade(sequence, folder, **how)
            variant = map_id(folder.name)
            self._server.ingest(variant, folder)
            result[title] = judge(variant)
            self._server.delete(variant)
        return result


def simulate(build, scratch, quick, only):
    """Writes the simulator's scenes and returns their folders."""
    folders = []
    for scene, frames in (QUICK_SCENES if quick else SCENES).items():
        if only and scene not in only:
            continue
        folders.append(pathlib.Path(scratch) / scene)
        subprocess.run([f"{build}/bin/clearance_sim", "--scene", scene, "--seed", "7", "--frames", str(frames),
                        "--quiet", "--out", str(folders[-1])], check=True)
    return folders


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", required=True, help="build folder with bin/")
    parser.add_argument("--data", type=pathlib.Path, help="folder of sequence folders")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "out/evaluation")
    parser.add_argument("--quick", action="store_true", help="fewer points and frames, no degraded labels")
    parser.add_argument("--only", nargs="*", help="names of the recordings to measure")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    results = {}
    with tempfile.TemporaryDirectory() as scratch, Server(arguments.build, ROOT) as server:
        if arguments.data:
            folders = [p.parent for p in sorted(arguments.data.glob("*/sequence.json"))
                       if not arguments.only or p.parent.name in arguments.only]
            if not folders:
                parser.error(f"{arguments.data} holds no sequence folder (NAME/sequence.json)")
        else:
            folders = simulate(arguments.build, scratch, arguments.quick, arguments.only)
        evaluation = Evaluation(server, scratch, arguments.quick)
        for folder in folders:
            started = time.monotonic()
            try:
                results[folder.name] = evaluation.run(folder)
            except (RuntimeError, OSError, ValueError, KeyError) as error:
                results[folder.name] = {"error": f"{type(error).__name__}: {error}"}
            print(f"{folder.name}: {time.monotonic() - started:.0f} s", flush=True)
            # After each recording, so that a broken run leaves what it had.
            (arguments.out / "results.json").write_text(json.dumps(results, indent=1) + "\n")
            (arguments.out / "results.md").write_text(report.markdown(results))
    print()
    print((arguments.out / "results.md").read_text())
    print(f"written: {arguments.out}/results.md and results.json")
    return 1 if any("error" in r for r in results.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
