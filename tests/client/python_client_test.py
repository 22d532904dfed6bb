"""The Python client against the server whose address is the first argument."""

import sys
import unittest

import grpc
import numpy as np

import clearance


def wall_points():
    """A wall at x = 4 m, seen from the origin, 5 cm apart."""
    y, z = np.meshgrid(np.arange(-3, 3, 0.05), np.arange(-1.5, 1.5, 0.05))
    return np.stack([np.full(y.size, 4.0), y.ravel(), z.ravel()], axis=1)


class PythonClient(unittest.TestCase):
    address = ""

    def test_measures_what_it_ingested(self):
        with clearance.Client(self.address, map="python") as client:
            client.create_map("python", voxel_size_m=0.1)
            with client.ingest("numpy") as stream:
                self.assertIsNone(stream.last_frame_id)
                for i in range(4):
                    stream.send(clearance.cloud_frame(
                        i, 10**9 + i * 10**8, clearance.pose([0, 0, 0]), wall_points()))
            self.assertEqual([ack.frame_id for ack in stream.acks], [0, 1, 2, 3])
            answers = client.query([[2.0, 0.0, 0.0], [3.5, 0.5, 0.2]])
            np.testing.assert_allclose(answers.distances_m, [2.0, 0.5], atol=0.06)
            self.assertEqual(list(answers.states & 3), [clearance.FREE, clearance.FREE])
            self.assertEqual(answers.gradients.shape, (2, 3))
            self.assertEqual(list(answers.object_ids), [0, 0])
            np.testing.assert_array_equal(
                client.distances(np.array([2.0, 0.0, 0.0]), horizon_s=0.5).shape, [1])
            self.assertEqual(client.objects(), [])
            with client.ingest("numpy") as stream:
                self.assertEqual(stream.last_frame_id, 3)

    def test_depth_images_and_moving_objects(self):
        depth = np.full((48, 64), 3000, np.uint16)
        labels = np.zeros((48, 64), np.uint16)
        depth[20:28, 28:36] = 2000
        labels[20:28, 28:36] = 3
        with clearance.Client(self.address, map="depth") as client:
            client.create_map("depth", voxel_size_m=0.1)
            with client.ingest() as stream:
                for i in range(4):
                    motion = clearance.object_motion(
                        3, world_motion=clearance.pose([0.0, 0.0, 0.0]), class_name="box")
                    stream.send(clearance.depth_frame(
                        i, 10**9 + i * 10**8, clearance.pose([0, 0, 0]), depth, (60, 60, 31.5, 23.5),
                        0.001, labels, [motion] if i else []))
            objects = client.objects(include_history=True)
            self.assertEqual([o.brief.object_id for o in objects], [3])
            self.assertEqual(objects[0].brief.class_name, "box")

    def test_watch_follows_the_poses_of_objects(self):
        depth = np.full((48, 64), 3000, np.uint16)
        labels = np.zeros((48, 64), np.uint16)
        depth[20:28, 28:36] = 2000
        labels[20:28, 28:36] = 3
        with clearance.Client(self.address, map="watched") as client:
            client.create_map("watched", voxel_size_m=0.1)
            watch = client.watch()
            stamp, objects = next(watch)
            self.assertEqual((stamp.revision, objects), (0, {}))
            with client.ingest() as stream:
                for i in range(4):
                    motion = clearance.object_motion(
                        3, world_motion=clearance.pose([0.0, 0.0, 0.1]), class_name="box")
                    stream.send(clearance.depth_frame(
                        i, 10**9 + i * 10**8, clearance.pose([0, 0, 0]), depth, (60, 60, 31.5, 23.5),
                        0.001, labels, [motion] if i else []))
            while stamp.revision < 4:
                stamp, objects = next(watch)
            watch.close()
            self.assertEqual(list(objects), [(3, 1)])
            mine, = objects.values()
            theirs, = client.objects()
            self.assertEqual(mine, theirs.brief)

    def test_errors_carry_code_and_text(self):
        with clearance.Client(self.address, map="nowhere") as client:
            with self.assertRaises(clearance.ClearanceError) as caught:
                client.distances([[0, 0, 0]])
            self.assertEqual(caught.exception.code, grpc.StatusCode.NOT_FOUND)
            self.assertIn("nowhere", str(caught.exception))
        with self.assertRaises(clearance.ClearanceError) as caught:
            clearance.Client("127.0.0.1:1", connect_timeout_s=0.5)
        self.assertEqual(caught.exception.code, grpc.StatusCode.UNAVAILABLE)
        self.assertIn("127.0.0.1:1", str(caught.exception))

    def test_points_of_another_shape_never_leave(self):
        with clearance.Client(self.address) as client:
            with self.assertRaisesRegex(ValueError, r"expected \(n, 3\)"):
                client.distances([[0, 0]])


if __name__ == "__main__":
    PythonClient.address = sys.argv.pop(1)
    unittest.main()
