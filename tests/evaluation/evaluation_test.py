"""The evaluation programs measure what they say: checked against closed forms and brute force, on
recordings that the simulator writes for the occasion.

    evaluation_test.py CLEARANCE_SIM      (CLEARANCE_TRUTH_LIBRARY names the built library)
"""
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np
from scipy.spatial.transform import Rotation

import degrade
import field_error
import free_space
import ghosts
import object_mesh
import poses
from meshes import Mesh, VoxelGrid
from sequence import Sequence
from server import Answer
from world import World

SIMULATOR = sys.argv.pop(1)
BOX_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])


def box(centre, half):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return Mesh(centre + corners * half, BOX_FACES)


def box_distance(points, centre, half):
    q = np.abs(points - centre) - half
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(1), 0)


class MeshQueries(unittest.TestCase):
    def test_distances_and_insides_of_a_box_are_exact_also_far_from_the_origin(self):
        rng = np.random.default_rng(0)
        for centre in (np.zeros(3), np.array([1e4, -2e4, 30.])):
            half = np.array([1.5, .4, .8])
            points = centre + rng.uniform(-3, 3, (3000, 3))
            distance, nearest, _ = box(centre, half).nearest(points)
            expected = box_distance(points, centre, half)
            np.testing.assert_allclose(distance, np.abs(expected), atol=1e-7)
            np.testing.assert_allclose(np.linalg.norm(nearest - points, axis=1), distance, atol=1e-7)
            inside = box(centre, half).inside(points)
            clear = np.abs(expected) > 1e-5
            np.testing.assert_array_equal(inside[clear], (expected < 0)[clear])
            self.assertTrue(inside.any())

    def test_a_box_blocks_exactly_the_lines_through_it(self):
        rng = np.random.default_rng(1)
        half, eye = np.array([1., 1., 1.]), np.array([-5., .3, -.2])
        targets = rng.uniform(-4, 4, (2000, 3))
        share = np.linspace(0, 1, 2001)[:, None]
        along = np.array([box_distance(eye + share * (t - eye), 0, half).min() for t in targets])
        blocked = box(np.zeros(3), half).blocked(eye, targets)
        clear = np.abs(along) > .01
        np.testing.assert_array_equal(blocked[clear], (along < 0)[clear])

    def test_samples_leave_out_what_is_buried_in_another_solid(self):
        a, b = box(np.zeros(3), np.ones(3)), box(np.array([1., 0, 0]), np.array([1., .5, .5]))
        both = Mesh(np.concatenate([a.vertices, b.vertices]), np.concatenate([a.faces, b.faces + 8]))
        points = both.sample(5000)
        for centre, half in ((np.zeros(3), np.ones(3)), (np.array([1., 0, 0]), np.array([1., .5, .5]))):
            self.assertGreater(box_distance(points, centre, half).min(), -1e-3)
        on_top = np.abs(points[:, 2] - 1) < 1e-9
        # The big box keeps 24 - 1 square metres, the small one 1 + 4.
        self.assertAlmostEqual(on_top.mean(), 4 / (23 + 5), delta=.02)

    def test_rays_are_counted_in_the_cells_they_leave_again(self):
        rng = np.random.default_rng(2)
        grid = VoxelGrid([-1, -1, -.6], [.8, 1, .6], .2)
        cells = np.argwhere(np.ones(grid.size, bool))
        after = rng.integers(-1, 4, grid.size).astype(np.int32)
        counts, total = np.zeros(grid.size, np.uint32), np.zeros(grid.size, np.uint32)
        low = (cells + grid.first) * .2
        for frame in (1, 2, 3):
            eye, ends = rng.uniform(-3, 3, 3), rng.uniform(-2, 2, (60, 3))
            grid.count_rays(eye, ends, after, frame, counts)
            through = np.zeros(grid.size, np.uint32)
            for end in ends:
                t = np.stack([(low - eye) / (end - eye), (low + .2 - eye) / (end - eye)])
                enter, leave = t.min(0).max(1), t.max(0).min(1)
                hit = (enter < leave) & (leave > 0) & (leave < 1)
                through[tuple(cells[hit].T)] += 1
            total += np.where((after >= 0) & (after < frame), through, 0).astype(np.uint32)
        self.assertGreater(total.sum(), 100)
        np.testing.assert_array_equal(counts, total)


class Recordings(unittest.TestCase):
    """Programs on recordings that the simulator writes."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        for scene, frames in (("hall", 4), ("crossing", 16), ("cubes", 6), ("parking", 60)):
            subprocess.run([SIMULATOR, "--scene", scene, "--seed", "3", "--frames", str(frames), "--quiet",
                            "--out", f"{cls.folder.name}/{scene}"], check=True)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def load(self, scene):
        sequence = Sequence(f"{self.folder.name}/{scene}")
        return sequence, World(sequence)

    def test_returns_lie_on_the_surface_that_their_label_names(self):
        for scene in ("hall", "crossing", "cubes"):
            sequence, world = self.load(scene)
            points, labels = sequence.scan(3)
            points = poses.apply(sequence.sensor_poses[3], points)
            for j in np.unique(labels):
                distance, _, _ = world.distance(points[labels == j], 3, objects=[j] if j else [],
                                                static=j == 0)
                self.assertLess(np.abs(distance).max(), 1e-3, f"{scene}, label {j}")

    def test_motions_chain_to_the_true_poses(self):
        sequence, world = self.load("cubes")
        for j, motions in sequence.motions.items():
            first = min(motions)
            T = world.pose(j, first - 1)
            for k in range(first, sequence.frame_count):
                T = motions[k] @ T
            np.testing.assert_allclose(T, world.pose(j, sequence.frame_count - 1), atol=1e-9)

    def test_the_true_mesh_scores_full_marks_and_a_grown_one_its_error(self):
        sequence, world = self.load("cubes")
        truth = world.objects[1]
        dense = truth.sample(20000, seed=9)
        result = object_mesh.evaluate(world, 1, dense, truth.faces[:0], samples=2000)
        self.assertLess(result["rmse_m"], 1e-6)
        self.assertGreater(result["r_cov"], .999)
        grown = object_mesh.evaluate(world, 1, truth.vertices * (1 + .02 / .15), truth.faces, samples=2000)
        self.assertAlmostEqual(grown["rmse_m"], .02 * np.sqrt(3), places=6)
        self.assertGreater(grown["r_cov_surface"], .99)
        self.assertLess(grown["r_cov"], .5)
        # A cube shows at most three of its six faces at once, and turns little in 0.2 s.
        self.assertGreater(grown["visible_share"], .15)
        self.assertLess(grown["visible_share"], .7)

    def test_ghosts_are_counted_where_movers_were_and_rays_came_after(self):
        sequence, world = self.load("crossing")
        space = ghosts.swept_space(sequence, world)
        self.assertGreater(len(space.centres), 200)
        self.assertGreater(world.distance(space.centres, objects=[])[0].min(), sequence.voxel_m - 1e-9)
        held = np.zeros(len(space.centres), bool)
        for k in range(sequence.frame_count):
            held |= world.distance(space.centres, k, static=False)[0] < 0
        self.assertTrue(held.all())
        last = world.distance(space.centres, sequence.frame_count - 1, static=False)[0]
        self.assertGreater(last.min(), 0)
        found, where = ghosts.evaluate(space, lambda p: np.where(p[:, 2] > 1, 2, 1))
        self.assertEqual(found["ghosts"], int((space.centres[:, 2] > 1).sum()))
        self.assertEqual(len(where), found["ghosts"])
        self.assertGreater(found["ghosts"], 0)

    def test_annotated_boxes_find_the_space_that_the_true_shapes_swept(self):
        sequence, world = self.load("crossing")
        exact = ghosts.swept_space(sequence, world)
        boxes = pathlib.Path(f"{self.folder.name}/crossing-boxes")
        boxes.mkdir()
        for path in sequence.folder.iterdir():
            if path.name != "gt":
                (boxes / path.name).symlink_to(path)
        with open(boxes / "object_poses.csv", "w") as out:
            out.write("frame,object_id,tx,ty,tz,qx,qy,qz,qw\n")
            sizes = sequence.box_sizes()
            for j, known in sequence.object_poses.items():
                for k in range(sequence.frame_count):
                    centre = poses.apply(known[k], np.array([0, 0, sizes[j][2] / 2]))
                    turn = Rotation.from_matrix(known[k][:3, :3]).as_quat()
                    out.write(",".join(map(str, [k, j, *centre, *turn])) + "\n")
        recording = Sequence(boxes)
        self.assertFalse(recording.exact)
        rough = ghosts.swept_space(recording)
        self.assertGreaterEqual(rough.swept, exact.swept)
        found = {tuple(c) for c in np.round(rough.centres, 6)}
        again = np.array([tuple(c) in found for c in np.round(exact.centres, 6)])
        self.assertGreater(again.mean(), .7)
        # Static surfaces are known from sparse returns only, but those must keep their distance.
        true = world.distance(rough.centres, objects=[])[0]
        self.assertLess((true < 0).mean(), .02)

    def test_field_errors_are_zero_for_the_truth_and_the_bias_for_a_biased_field(self):
        sequence, world = self.load("crossing")
        observed = field_error.ObservedSurface(world)
        frame = sequence.frame_count - 1
        placed = {j: world.pose(j, frame) for j in world.objects}
        movers = field_error.movers_in_view(world)
        near = field_error.points_near_objects(world, movers, placed, 2000)
        to_objects = world.distance(near, frame, static=False)[0]
        self.assertTrue((to_objects < 2).all())
        self.assertTrue((to_objects < 0).any())
        for points, where in ((field_error.points_in_the_open(sequence, 600), None), (near, placed)):
            for bias in (0.0, .1):
                def answer(p):
                    distance, nearest, owner = world.distance(p, placed=where or {}, objects=list(where or []))
                    gradient = (p - nearest) / distance[:, None]
                    return Answer(distance + bias, np.ones(len(p), int), gradient, owner, np.zeros(len(p), bool))
                rows = field_error.evaluate(world, observed, points, answer, 5.0, where)
                result = rows["all" if where else "open"]
                self.assertAlmostEqual(result["mean"], bias / sequence.voxel_m, places=9)
                self.assertAlmostEqual(result["gradient_p95_deg"], 0, delta=1e-3)
                self.assertGreater(result["points"], 100)
                # Rings of a lidar leave gaps on the ground, and backs are never seen.
                self.assertGreater(result["observed_share"], .2)
                self.assertLess(result["observed_share"], .95)
        parts = [rows[k]["points"] for k in ("outside boxes", "in boxes, outside solids")]
        self.assertEqual(sum(parts), rows["all"]["points"])
        self.assertGreater(min(parts), 0)

    def test_free_space_is_the_whole_slab_for_the_truth(self):
        sequence, world = self.load("hall")
        sequence.sensor["max_range_m"] = 8  # a smaller slab
        truth = free_space.FreeSpace(world, thickness_m=.4)
        lookup = {tuple(c): s for c, s in zip(np.round(truth.centres, 6), truth.state)}

        def exact(points):
            states = np.array([lookup[tuple(p)] for p in np.round(points, 6)])
            return states, np.zeros(len(points), bool)
        result = truth.evaluate(exact)
        self.assertEqual((result["TP"], result["FN"], result["FP"]), (result["truth_free"], 0, 0))
        self.assertGreater(result["truth_free"], 1000)
        wrong = truth.evaluate(lambda p: (3 - exact(p)[0], np.zeros(len(p), bool)))
        self.assertEqual((wrong["FN"], wrong["FP"]), (result["truth_free"], result["truth_occupied"]))

    def test_shrunk_labels_lose_their_borders_and_late_ones_their_first_frames(self):
        for scene in ("cubes", "crossing"):
            sequence, _ = self.load(scene)
            copy = degrade.Degraded(sequence, shrink_px=3, late_frames=2)
            seen, lost = {}, 0
            for k in range(sequence.frame_count):
                (points, labels), (same, fewer) = sequence.scan(k), copy.scan(k)
                np.testing.assert_array_equal(points, same)
                self.assertTrue(((fewer == labels) | (fewer == 0)).all())
                for j in np.unique(labels[labels > 0]):
                    seen[j] = seen.get(j, 0) + 1
                    if seen[j] <= 2:
                        self.assertFalse((fewer == j).any())
                lost += (labels != fewer).sum()
            self.assertGreater(lost, 100)
            for j, motions in copy.motions.items():
                first = min(k for k in range(copy.frame_count)
                            if (sequence.scan(k)[1] == j).any())
                if motions:
                    self.assertGreater(min(motions), first + 2)

    def test_grown_labels_gain_static_borders_only(self):
        for scene in ("cubes", "crossing"):
            sequence, _ = self.load(scene)
            labels, grown = sequence.scan(3)[1], degrade.Degraded(sequence, grow_px=3).scan(3)[1]
            self.assertTrue((grown[labels > 0] == labels[labels > 0]).all())
            self.assertGreater((grown != labels).sum(), 20)
            self.assertLess((grown != labels).sum(), 4 * (labels > 0).sum())

    def test_depth_noise_has_the_deviation_asked_for_and_repeats(self):
        for scene in ("cubes", "crossing"):
            sequence, _ = self.load(scene)
            points, labels = sequence.scan(2)
            noisy, same = degrade.Degraded(sequence, depth_sigma_m=.02).scan(2)
            np.testing.assert_array_equal(labels, same)
            step = noisy - points
            along = step[:, 2] if sequence.is_camera else np.sum(step * points, 1) / np.linalg.norm(points, axis=1)
            self.assertAlmostEqual(along.std(), .02, delta=.001)
            self.assertAlmostEqual(along.mean(), 0, delta=.001)
            again, _ = degrade.Degraded(sequence, depth_sigma_m=.02).scan(2)
            np.testing.assert_array_equal(noisy, again)

    def test_bridged_motions_span_the_lost_frame(self):
        sequence, world = self.load("crossing")
        bridged = degrade.Degraded(sequence, lost_every=5, bridged_motions=True)
        self.assertEqual(bridged.frames(), [k for k in range(16) if k % 5 != 1])
        for j, from_frame, H in bridged.motions_of(7):
            self.assertEqual(from_frame, 5)
            np.testing.assert_allclose(H @ world.pose(j, 5), world.pose(j, 7), atol=1e-9)
        self.assertTrue(bridged.motions_of(7))
        broken = degrade.Degraded(sequence, lost_every=5)
        for j, from_frame, H in broken.motions_of(7):
            self.assertEqual(from_frame, 6)
            np.testing.assert_allclose(H @ world.pose(j, 6), world.pose(j, 7), atol=1e-9)
        self.assertTrue(all(start is None for _, start, _ in broken.motions_of(8)))

    def test_motion_noise_is_about_the_object(self):
        sequence, _ = self.load("crossing")
        shaken = degrade.Degraded(sequence, motion_sigma_m=.02)
        steps, turns = [], []
        for j, known in sequence.motions.items():
            for k, H in known.items():
                E = shaken.motions[j][k] @ poses.inverse(H)
                centre = sequence.object_poses[j][k][:3, 3]
                steps.append(poses.apply(E, centre) - centre)
                turns.append(Rotation.from_matrix(E[:3, :3]).as_rotvec())
        self.assertAlmostEqual(np.std(steps), .02, delta=.004)
        self.assertAlmostEqual(np.std(turns), .01, delta=.002)

    def test_objects_that_stand_lose_label_and_motion(self):
        sequence, _ = self.load("parking")
        still = degrade.Degraded(sequence, still_is_static=True)
        started, parked = set(np.unique(still.scan(1)[1])), set(np.unique(still.scan(sequence.frame_count - 1)[1]))
        self.assertIn(1, started)
        self.assertNotIn(2, started)
        self.assertNotIn(1, parked)
        self.assertIn(2, parked)
        for j, known in still.motions.items():
            for H in known.values():
                self.assertGreater(np.abs(H - np.eye(4)).max(), 1e-4, f"object {j}")

    def test_constant_twist_is_the_true_motion_of_what_moves_steadily(self):
        sequence, world = self.load("crossing")
        steady = 0
        for j in world.objects:
            for h in (.5, 1.):
                ahead = world.pose(j, 5 + h * sequence.rate_hz)
                known = sequence.object_poses[j]
                H = known[5] @ poses.inverse(known[4])
                if all(np.allclose(known[k + 1], H @ known[k], atol=1e-6) for k in range(5, 16)):
                    np.testing.assert_allclose(world.carried(j, 5, h), ahead, atol=1e-4)
                    steady += 1
        self.assertGreater(steady, 5)

    def test_shrunk_images_keep_what_is_three_pixels_inside(self):
        label = np.zeros((20, 30), np.uint16)
        label[5:15, 8:20] = 4
        label[5:15, 20:29] = 6
        shrunk = degrade._shrink_image(label, 3)
        expected = np.zeros_like(label)
        expected[8:12, 11:17] = 4
        expected[8:12, 23:26] = 6
        np.testing.assert_array_equal(shrunk, expected)


if __name__ == "__main__":
    unittest.main()
