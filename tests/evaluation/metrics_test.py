"""Metric functions against cases worked out by hand, and on input that lacks something."""
import json
import pathlib
import tempfile
import unittest

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import field_error
import ghosts
import object_mesh
import occupancy
import poses
import report
import tables
import targets
import tum_rgbd
from meshes import Mesh
from sequence import Sequence
from server import Answer

SQUARE = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])  # z = 0
BOX_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])


def box(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return Mesh(np.asarray(low) + corners * (np.asarray(high) - low), BOX_FACES)


def motion(turn, shift):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
    return T


class ObjectMeshes(unittest.TestCase):
    def test_coverage_and_rmse_of_a_square_by_hand(self):
        samples = np.array([[.1, .1, 0], [.5, .5, 0], [.9, .9, 0], [.9, .1, 0]])
        visible = np.array([True, True, False, False])
        # Reach 0.2 / 2 * sqrt(3) = 0.1732: the first vertex covers the first sample, the second the third.
        vertices = np.array([[.1, .1, .1], [.9, .8, -.1], [.5, 3, 0]])
        result = object_mesh.compare(SQUARE, vertices, np.array([[0, 1, 2]]), samples, visible, .2)
        self.assertEqual(result["r_cov"], .5)
        self.assertEqual(result["r_cov_visible"], .5)
        self.assertEqual(result["visible_share"], .5)
        self.assertAlmostEqual(result["rmse_m"], np.sqrt((.01 + .01 + 4) / 3))
        self.assertAlmostEqual(result["max_m"], 2)
        # The triangle passes under the middle sample; to the last it keeps 0.29.
        self.assertEqual(result["r_cov_surface"], .75)
        self.assertEqual(result["r_cov_surface_visible"], 1)

    def test_an_empty_mesh_covers_nothing_and_has_no_error(self):
        result = object_mesh.compare(SQUARE, np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros((4, 3)),
                                     np.zeros(4, bool), .1)
        self.assertEqual((result["r_cov"], result["rmse_m"], result["r_cov_visible"]), (0, None, None))

    def test_open_meshes_are_told_from_closed_ones_and_can_be_sampled(self):
        self.assertTrue(box([0, 0, 0], [1, 2, 3]).closed)
        self.assertFalse(SQUARE.closed)
        # A box without its top, faces turned inwards.
        open_box = Mesh(box([0, 0, 0], [1, 1, 1]).vertices, BOX_FACES[[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]][:, ::-1])
        self.assertFalse(open_box.closed)
        points = open_box.sample(500)
        self.assertEqual(points.shape, (500, 3))
        self.assertLess(open_box.nearest(points)[0].max(), 1e-6)


class FieldErrors(unittest.TestCase):
    def test_statistics_by_hand(self):
        row = field_error.statistics(np.array([.1, -.1, .3]), .1)
        for name, value in (("bias", 1), ("mean", 5 / 3), ("median", 1), ("max", 3), ("above_half", 1)):
            self.assertAlmostEqual(row[name], value)
        self.assertEqual(field_error.statistics(np.zeros(0), .1), {"points": 0})

    def test_gradients_are_compared_by_angle_where_both_exist(self):
        points = np.array([[0, 0, 1], [0, 0, -2], [0, 0, 0], [1, 0, 1]], float)
        nearest = points * [1, 1, 0]
        true = np.array([1, -2, 0, 1.0])  # the second is inside: the gradient still points up
        answered = np.array([[0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 0, 0]], float)
        row = field_error.gradient_statistics(points, nearest, true, answered)
        self.assertEqual(row["gradients"], 2)
        self.assertAlmostEqual(row["gradient_mean_deg"], 45)


class Screws(unittest.TestCase):
    def test_half_a_quarter_turn_about_an_axis_that_misses_the_origin(self):
        # A quarter turn about the vertical through (1, 0), rising by 2.
        H = motion([0, 0, np.pi / 2], [1, -1, 2])
        half = poses.power(H, .5)
        np.testing.assert_allclose(poses.apply(half, np.array([[2, 0, 0]])),
                                   [[1 + np.sqrt(.5), np.sqrt(.5), 1]], atol=1e-12)

    def test_whole_powers_are_products(self):
        rng = np.random.default_rng(3)
        for size in (1e-12, 1e-3, 1.0):
            H = motion(rng.normal(0, size, 3), rng.normal(size=3))
            for n, expected in ((0, np.eye(4)), (1, H), (3, H @ H @ H), (-1, poses.inverse(H))):
                np.testing.assert_allclose(poses.power(H, n), expected, atol=1e-8)


class Occupancy(unittest.TestCase):
    def test_the_voxels_of_a_box_are_those_that_its_faces_cut(self):
        v = .25
        for low, high in (([-1.13, -.71, .06], [.92, .33, .41]), ([10.1, 20.2, -30.3], [11.05, 20.9, -29.9])):
            low, high = np.array(low), np.array(high)
            shape = box(low, high)
            found = occupancy.surface_voxels(shape.vertices, shape.faces, v, np.array([(low + high) / 2]), 50)
            cells = np.indices(np.ceil((high - low) / v).astype(int) + 3).reshape(3, -1).T
            cells = cells + np.floor(low / v).astype(int) - 1
            a, b = cells * v, (cells + 1) * v
            cut = ((b >= low) & (a <= high)).all(1) & ~((a > low) & (b < high)).all(1)
            expected = {tuple(c) for c in cells[cut]}
            self.assertEqual({tuple(c) for c in np.floor(found / v).astype(int)}, expected)

    def test_surface_between_two_layers_of_voxels_is_in_neither(self):
        near = np.array([[.5, .5, 0.]])
        self.assertEqual(len(occupancy.surface_voxels(SQUARE.vertices, SQUARE.faces, .1, near, 3)), 0)
        lifted = SQUARE.vertices + [0, 0, .01]
        self.assertEqual(len(occupancy.surface_voxels(lifted, SQUARE.faces, .1, near, 3)), 100)

    def test_only_voxels_within_reach_are_given(self):
        near = np.array([[.5, .5, 1.0]])
        found = occupancy.surface_voxels(SQUARE.vertices + [0, 0, .05], SQUARE.faces, .1, near, 1.1)
        self.assertGreater(len(found), 20)
        self.assertLess(len(found), 400)
        self.assertLessEqual(np.linalg.norm(found - near, axis=1).max(), 1.1)

    def test_states_are_counted_among_what_is_known(self):
        states = np.array([2, 2, 1, 1, 0, 0, 0, 0])
        low = np.array([0, 1, 1, 0, 0, 0, 0, 0], bool)
        row = occupancy.judge(np.zeros((8, 3)), lambda p: Answer(None, states, None, None, low))
        self.assertEqual((row["known"], row["free_high"], row["free_low"], row["unknown"]), (4, 1, 1, 4))
        self.assertEqual((row["free_high_share"], row["free_high_share_of_known"]), (.125, .25))

    def test_ghosts_are_the_occupied_ones(self):
        space = ghosts.SweptSpace(np.arange(9.).reshape(3, 3), 7, 5)
        row, where = ghosts.evaluate(space, lambda p: np.array([1, 2, 0]))
        self.assertEqual((row["free"], row["ghosts"], row["unknown"], row["seen_again"]), (1, 1, 1, 3))
        np.testing.assert_array_equal(where, [[3, 4, 5]])


def results(**measures):
    return {"recordings": {"street-3": {"errors": {}, **measures}}, "robustness": {}, "ablations": {}, "errors": {}}


class Reports(unittest.TestCase):
    def test_targets_are_judged_from_the_numbers(self):
        stats = {"points": 10, "mean": .1500001, "p95": .4}
        row = {"object": 1, "frames_in_view": 10, "rmse_m": .05, "r_cov_surface_visible": .9499, "visible_share": .4}
        few = dict(row, object=2, frames_in_view=9, rmse_m=1.0)
        lost = {"object": 3, "frames_in_view": 20, "error": "NOT_FOUND"}
        judged = {(j.what, j.where): j.met for j in targets.judge(results(static=stats, objects=[row, few, lost]))}
        self.assertEqual(judged, {
            ("RMSE", "street-3, object 1"): True, ("visible surface covered", "street-3, object 1"): False,
            ("RMSE", "street-3, object 3"): False, ("visible surface covered", "street-3, object 3"): False,
            ("distance error, static, mean", "street-3"): False, ("distance error, static, p95", "street-3"): True})

    def test_noisy_recordings_are_not_held_to_the_noise_free_target(self):
        noisy = results(static={"points": 10, "mean": 1.0, "p95": 2.0}, depth_noise_m=.01)
        self.assertEqual(targets.judge(noisy), [])

    def test_every_table_can_do_with_nothing_and_with_a_failure(self):
        for given in (results(), results(errors={"static": "ValueError: x"})):
            for make in tables.ALL:
                for row in make(given).rows:
                    self.assertEqual(len(row), len(make(given).header))
            self.assertIn("# Results", report.markdown(given))
        self.assertIn("street-3, static: ValueError: x", report.markdown(given))

    def test_written_files_agree(self):
        given = results(ghosts={"as recorded": {"swept": 9, "away_from_static": 8, "seen_again": 5, "free": 4,
                                                "unknown": 0, "ghosts": 1}})
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder)
            report.write(given, out)
            self.assertEqual(json.loads((out / "results.json").read_text()), given)
            self.assertIn("street-3,as recorded,9,8,5,4,0,1", (out / "ghosts.csv").read_text())
            self.assertIn("0 of 1 targets met", (out / "results.md").read_text())
        self.assertIn("| ghost voxels | 1 | <= 0: met by 0 of 1 |", report.readme(given))


class Folders(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self._folder.name)

    def tearDown(self):
        self._folder.cleanup()

    def test_a_tum_recording_becomes_a_sequence(self):
        source, out = self.folder / "freiburg", self.folder / "out"
        (source / "depth").mkdir(parents=True)
        rng, images = np.random.default_rng(0), []
        stamps = [10.0, 10.05, 10.1, 11.0]  # the last one has no pose near it
        for stamp in stamps:
            images.append(rng.integers(0, 20000, (6, 8)).astype(np.uint16))
            cv2.imwrite(str(source / f"depth/{stamp:.2f}.png"), images[-1])
        (source / "depth.txt").write_text("# depth maps\n# timestamp filename\n" + "".join(
            f"{s:.2f} depth/{s:.2f}.png\n" for s in stamps))
        (source / "groundtruth.txt").write_text("# ground truth\n10.0 1 2 3 0 0 0 1\n10.1 2 2 3 0 0 "
                                                f"{np.sin(.1)} {np.cos(.1)}\n12 0 0 0 0 0 0 1\n")
        self.assertEqual(tum_rgbd.convert(source, out, intrinsics=(5, 5, 3.5, 2.5)), 3)
        sequence = Sequence(out)
        np.testing.assert_allclose(sequence.sensor_poses[1], motion([0, 0, .1], [1.5, 2, 3]), atol=1e-8)
        np.testing.assert_array_equal(sequence.images(2)[0], images[2])
        points, labels = sequence.scan(0)
        self.assertFalse(labels.any())
        v, u = np.argwhere(images[0] > 0)[0]
        z = images[0][v, u] / 5000
        np.testing.assert_allclose(points[0], [(u - 3.5) / 5 * z, (v - 2.5) / 5 * z, z])

    def test_a_folder_without_labels_motions_boxes_and_voxel_size_can_be_read(self):
        (self.folder / "depth").mkdir()
        for k in range(2):
            cv2.imwrite(str(self.folder / f"depth/{k:06d}.png"), np.full((4, 4), 1000, np.uint16))
        (self.folder / "trajectory.tum").write_text("0 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n")
        sensor = {"type": "depth_camera", "width": 4, "height": 4, "fx": 4, "fy": 4, "cx": 1.5, "cy": 1.5,
                  "depth_scale_m": .001}
        (self.folder / "sequence.json").write_text(json.dumps({"sensor": sensor, "frame_count": 5}))
        sequence = Sequence(self.folder)
        self.assertEqual((sequence.frame_count, sequence.rate_hz, sequence.voxel_m), (2, 2.0, .1))
        self.assertEqual((sequence.box_sizes(), sequence.motions_of(1), sequence.exact), ({}, [], False))
        self.assertEqual(len(sequence.scan(1)[0]), 16)


if __name__ == "__main__":
    unittest.main()
