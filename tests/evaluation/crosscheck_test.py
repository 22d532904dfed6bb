"""Our exact truth against independent oracles on the shared sequences, where those are at hand.

CLEARANCE_DATA_DIR (default ../shared/data beside the source tree) holds the sequences; ../tools beside
it the oracles, which are run as programs.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import free_space
import object_mesh
import ply
import poses
from sequence import Sequence
from world import World

ROOT = pathlib.Path(__file__).resolve().parents[2]
DATA = pathlib.Path(os.environ.get("CLEARANCE_DATA_DIR") or ROOT.parent / "shared/data").resolve()
TOOLS = DATA.parent / "tools"


def oracle(program, *arguments):
    """What the program prints; skips where the oracles' own libraries are missing."""
    done = subprocess.run([sys.executable, "-B", str(TOOLS / program), *map(str, arguments)],
                          capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if "ModuleNotFoundError" in done.stderr:
        raise unittest.SkipTest(f"{program}: {done.stderr.splitlines()[-1]}")
    if done.returncode != 0:
        raise RuntimeError(f"{program}: {done.stderr}")
    return done.stdout


@unittest.skipUnless((TOOLS / "truth.py").exists(), f"no oracles in {TOOLS}")
class Oracles(unittest.TestCase):
    def open(self, name):
        if not (DATA / name / "sequence.json").exists():
            self.skipTest(f"no sequence {DATA / name}")
        sequence = Sequence(DATA / name)
        return sequence, World(sequence)

    def test_distances_agree_now_between_frames_and_in_the_future(self):
        rng = np.random.default_rng(0)
        for name, frames in (("street", (42.5, 75)), ("orbit", (120,)), ("hall", (40,))):
            sequence, world = self.open(name)
            for frame in frames:
                eye = sequence.sensor_poses[min(int(frame), sequence.frame_count - 1)][:3, 3]
                points = eye + rng.uniform(-12, 12, (3000, 3)) * [1, 1, .15]
                with tempfile.TemporaryDirectory() as scratch:
                    asked, out = f"{scratch}/points.csv", f"{scratch}/out.csv"
                    np.savetxt(asked, points, delimiter=",", header="x,y,z", comments="", fmt="%.9f")
                    oracle("truth.py", sequence.folder, "--frame", frame, "--points", asked, "--out", out)
                    theirs = np.loadtxt(out, delimiter=",", skiprows=1)
                distance, nearest, owner = world.distance(points, frame)
                # Between frames they go along the twist, we along the chord.
                slack = 1e-5 if frame == int(frame) else .01
                self.assertLess(np.quantile(np.abs(distance - theirs[:, 3]), .999), slack, f"{name} {frame}")
                same = np.abs(distance - theirs[:, 3]) < slack
                clear = same & (np.abs(distance) > .05)
                self.assertGreater((owner[clear] == theirs[clear, 7]).mean(), .995)
                gradient = (points - nearest) / distance[:, None]
                along = np.sum(gradient[clear] * theirs[clear, 4:7], axis=1)
                self.assertGreater((along > .999).mean(), .99)

    def test_coverage_and_rmse_agree(self):
        for name, j, frame in (("street", 1, 10), ("orbit", 1, 20)):
            sequence, world = self.open(name)
            # A stand-in for a reconstruction: part of the true shape, moved a little.
            rng = np.random.default_rng(1)
            vertices = world.objects[j].sample(3000, seed=4)
            vertices = vertices[vertices[:, 0] > 0] + rng.normal(0, .01, (int((vertices[:, 0] > 0).sum()), 3))
            with tempfile.TemporaryDirectory() as scratch:
                path = f"{scratch}/mesh.ply"
                ply.write_cloud(path, vertices, np.zeros(len(vertices), int))
                printed = oracle("eval_mesh.py", sequence.folder, j, path, "--frame", frame, "--body", "--json",
                                 "--samples", 20000)
            theirs = json.loads(printed.splitlines()[-1])
            points = world.objects[j].sample(20000)
            visible = world.visible(j, points, range(frame + 1))
            ours = object_mesh.compare(world.objects[j], vertices, np.zeros((0, 3), int), points, visible,
                                       sequence.voxel_m)
            self.assertAlmostEqual(ours["rmse_m"], theirs["rmse"], delta=1e-5)
            # Random samples of their own: a few standard deviations.
            for mine, their in (("r_cov", "r_cov"), ("r_cov_visible", "r_cov_visible"),
                                ("visible_share", "visible_share")):
                self.assertAlmostEqual(ours[mine], theirs[their], delta=.02, msg=f"{name} {mine}")

    def test_free_space_of_the_hall_agrees_voxel_by_voxel(self):
        sequence, world = self.open("hall")
        if not (sequence.folder / "gt/free_space.npz").exists():
            self.skipTest("no gt/free_space.npz")
        slab = free_space.FreeSpace(world)
        known = slab.state > 0
        with tempfile.TemporaryDirectory() as scratch:
            path = f"{scratch}/states.csv"
            np.savetxt(path, np.column_stack([slab.centres[known], slab.state[known]]), delimiter=",",
                       header="x,y,z,state", comments="", fmt=["%.6f"] * 3 + ["%d"])
            printed = oracle("free_space.py", sequence.folder, "--eval", path)
        theirs = json.loads(printed.replace("'", '"'))
        free, occupied = int((slab.state == 1).sum()), int((slab.state == 2).sum())
        self.assertLess(abs(theirs["ground_truth_free"] - free), 5e-4 * free)
        self.assertGreater(theirs["TP"], .9995 * theirs["ground_truth_free"])
        self.assertLess(theirs["FN"] + theirs["FP"], 5)
        self.assertLess(abs(theirs["ground_truth_occupied"] - occupied), 5)

    def test_poses_of_the_sequences_are_rigid_and_motions_chain(self):
        for name in ("street", "cubes"):
            sequence, world = self.open(name)
            for j, motions in sequence.motions.items():
                for k, H in motions.items():
                    np.testing.assert_allclose(H @ world.pose(j, k - 1), world.pose(j, k), atol=1e-5)
                    self.assertAlmostEqual(np.linalg.det(H[:3, :3]), 1, places=9)
            np.testing.assert_allclose(poses.power(H, 2), H @ H, atol=1e-8)


if __name__ == "__main__":
    unittest.main()
