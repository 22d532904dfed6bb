#!/usr/bin/env python3
"""Streams recordings into a server, compares its answers with the exact truth and writes the tables.

    evaluate.py --build DIR [--data DIR] [--out DIR] [--quick] [--only NAME ...] [--parts PART ...]

--data: a folder of sequence folders; without it the simulator writes its own scenes. Every recording
is measured in all the ways its data allow; what fails is listed and does not stop the rest.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile
import time
import traceback

import numpy as np

import ablation
import plots
import poses
import report
import robustness
import targets
from coverage import CoverageCurves
from degrade import Degraded
from mapping import Mapping
from measures import Effort, Measures
from sequence import Sequence
from server import Server
from world import World

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = {"street": 60, "orbit": 200, "cubes": 150, "hall": 80, "crossing": 60, "parking": 80, "plane": 24,
          "box": 24, "sphere": 24, "corner": 24, "pole": 24}
QUICK_SCENES = {"street": 25, "orbit": 20, "cubes": 30, "hall": 20, "crossing": 30, "parking": 60, "box": 24,
                "corner": 24}
PARTS = ("recordings", "robustness", "ablations")
ABLATED = ("street", "corner")  # kinds of recordings; the first of each


class Evaluation:
    def __init__(self, server, arguments, out):
        self._server, self._build, self._quick, self._out = server, arguments.build, arguments.quick, out
        self._effort = Effort.quick() if arguments.quick else Effort()
        self.results = {"recordings": {}, "robustness": {}, "ablations": {}, "errors": {}}

    def _try(self, errors, what, measure, *arguments):
        """The measure, or None: its error is noted and the rest goes on."""
        try:
            return measure(*arguments)
        except Exception as error:  # pylint: disable=broad-except
            errors[what] = f"{type(error).__name__}: {error}"
            traceback.print_exc()
            return None

    def open(self, folder):
        """The recording and its exact world (None where it has none)."""
        sequence = Sequence(folder)
        return sequence, World(sequence) if sequence.exact else None

    def record(self, folder):
        """All measures of one recording."""
        sequence, world = self.open(folder)
        measures = Measures(sequence, world, self._effort)
        result = {"frames": sequence.frame_count, "voxel_m": sequence.voxel_m, "errors": {},
                  "depth_noise_m": sequence.info.get("depth_noise_m", 0.0)}
        self.results["recordings"][sequence.name] = result
        with Mapping(self._server, sequence) as mapping:
            self._stream(mapping, measures, result)
            wanted = {"times": mapping.times, "returns": lambda: measures.returns(mapping)}
            if world:
                wanted["static"] = lambda: measures.static_distances(mapping)
                wanted["truly_occupied"] = lambda: measures.truly_occupied(mapping)
                if not sequence.is_camera:
                    wanted["free_space"] = lambda: measures.free_space(mapping)
                if world.objects:
                    wanted["near_objects"] = lambda: measures.near_objects(mapping)
            if measures.has_swept_space:
                wanted["ghosts"] = lambda: {"as recorded": measures.ghosts(mapping)}
            for what, measure in wanted.items():
                result[what] = self._try(result["errors"], what, measure) or {}
        if world and targets.kind(sequence.name) == "parking":
            self._parked(sequence, measures, result)
        result["stage_times"] = self._try(result["errors"], "stage times", ablation.stage_times, self._build,
                                          sequence, self._quick) or {}

    def _stream(self, mapping, measures, result):
        world, sequence = measures.world, measures.sequence
        if not world or not world.objects:
            mapping.stream()
            return
        curves = CoverageCurves(world, self._effort.samples, self._effort.every)
        last, shots = sequence.frame_count - 1, []

        def after(k):
            curves.after(k, sequence.scan(k)[1], mapping.mesh)
            if targets.kind(sequence.name) == "cubes" and k in (last // 3, 2 * last // 3, last):
                shots.append((k, self._shot(world, k, mapping)))
        mapping.stream(after=after)
        result["coverage"] = curves.rows
        result["objects"] = [row for _, row in sorted(curves.final().items())]
        if shots:
            self._try(result["errors"], "pictures", plots.phases, sequence.name, shots, self._out)

    def _shot(self, world, k, mapping):
        objects = []
        for j, mesh in world.objects.items():
            try:
                vertices, faces = mapping.mesh(j)
            except RuntimeError:
                vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), int)
            T = world.pose(j, k)
            error = mesh.nearest(poses.apply(poses.inverse(T), vertices))[0] if len(vertices) else np.zeros(0)
            objects.append((j, poses.apply(T, mesh.vertices), mesh.faces, vertices, faces, error))
        return objects

    def _parked(self, sequence, measures, result):
        """Movers that park and parked cars that start, without labels while they stand."""
        with Mapping(self._server, Degraded(sequence, still_is_static=True), f"{sequence.name}-still") as mapping:
            mapping.stream()
            result["ghosts"]["parked without labels"] = measures.ghosts(mapping)
            near = measures.near_objects(mapping, (0.0, 1.0))
            for h, truths in near.items():
                if "true motion" in truths:
                    result["near_objects"].setdefault(h, {})["parked without labels"] = {
                        "all": truths["true motion"]["all"]}

    def robust(self, folder):
        sequence, world = self.open(folder)
        short = robustness.Shortened(sequence, robustness.FRAMES)
        # A dozen maps each: their differences show in a sample of the points.
        measures = Measures(short, world.of(short) if world else None, Effort.quick())
        rows = self.results["robustness"].setdefault(sequence.name, {})
        for title, how in robustness.variants(sequence, self._quick).items():
            try:
                rows[title] = robustness.measure(self._server, measures, how, f"{sequence.name}-variant")
            except Exception as error:  # pylint: disable=broad-except
                traceback.print_exc()
                rows[title] = {"error": f"{type(error).__name__}: {error}"}

    def ablate(self, folders):
        for kind in ABLATED:
            folder = next((f for f in folders if targets.kind(f.name) == kind), None)
            if not folder:
                continue
            sequence, world = self.open(folder)
            if not world:
                continue
            rows = self.results["ablations"].setdefault(sequence.name, [])
            for noise_m in (0.0, 0.02):
                done = self._try(self.results["errors"], f"ablations of {sequence.name}", ablation.variants,
                                 self._build, sequence, world, self._effort, self._quick, noise_m)
                rows += [done] if done else []
        self.results["local_fields"] = self._try(self.results["errors"], "local fields", ablation.local_fields,
                                                 self._build, self._quick) or {}

    def write(self):
        """After each step, so that a broken run leaves what it had."""
        self._try(self.results["errors"], "plots", plots.all_pictures, self.results, self._out)
        report.write(self.results, self._out)


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
    parser.add_argument("--quick", action="store_true", help="fewer points, frames and variants")
    parser.add_argument("--only", nargs="*", help="names of the recordings to measure")
    parser.add_argument("--parts", nargs="*", choices=PARTS, default=PARTS, help="which experiments (default: all)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, Server(arguments.build, ROOT) as server:
        if arguments.data:
            folders = [p.parent for p in sorted(arguments.data.glob("*/sequence.json"))
                       if not arguments.only or p.parent.name in arguments.only]
            if not folders:
                parser.error(f"{arguments.data} holds no sequence folder (NAME/sequence.json)")
        else:
            folders = simulate(arguments.build, scratch, arguments.quick, arguments.only)
        evaluation = Evaluation(server, arguments, arguments.out)
        steps = [(f"{f.name}", evaluation.record, f) for f in folders if "recordings" in arguments.parts]
        steps += [(f"{f.name}, robustness", evaluation.robust, f) for f in folders
                  if "robustness" in arguments.parts and targets.kind(f.name) not in targets.ANALYTIC]
        if "ablations" in arguments.parts:
            steps.append(("ablations", evaluation.ablate, folders))
        for title, step, argument in steps:
            started = time.monotonic()
            try:
                step(argument)
            except Exception as error:  # pylint: disable=broad-except
                traceback.print_exc()
                evaluation.results["errors"][title] = f"{type(error).__name__}: {error}"
            print(f"{title}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
            evaluation.write()
    print((arguments.out / "results.md").read_text())
    print(f"written: {arguments.out}/results.md, results.json, CSV files and pictures")
    failed = evaluation.results["errors"] or any(r["errors"] for r in evaluation.results["recordings"].values())
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
