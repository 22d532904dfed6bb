"""What the server keeps on disk, tried by force from outside: process_test.py SERVER COMMAND.

Kills, a second server on the folder, damaged files, a full disk; and `clearance snapshot`.
"""

import json
import os
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import grpc
import numpy as np

import clearance
from clearance.v1 import ingest_pb2, ingest_pb2_grpc, snapshot_pb2, snapshot_pb2_grpc

SERVER, COMMAND = sys.argv[1:3]
PROBES = np.random.default_rng(3).uniform([-1, -3, -1], [5, 3, 1], (500, 3))


def wall_frame(k):
    """A wall that comes nearer, seen from the origin."""
    y, z = np.meshgrid(np.arange(-2, 2, 0.1), np.arange(-1, 1, 0.1))
    points = np.stack([np.full(y.size, 4.0 - 0.01 * k), y.ravel(), z.ravel()], axis=1)
    return clearance.cloud_frame(k, 10**9 + k * 10**8, clearance.pose([0, 0, 0]), points)


class Server:
    """clearance_server on a folder; start() after kill() is a restart."""

    def __init__(self, folder, *settings):
        self.folder = pathlib.Path(folder)
        self.socket = str(self.folder / "socket")
        self.arguments = [SERVER, "--listen", "127.0.0.1:0", "--socket", self.socket, "--http",
                          "off", "--store", str(self.folder / "data"), "--set",
                          "map.voxel_size_m=0.2", "--set", "map.max_distance_m=2"]
        for setting in settings:
            self.arguments += ["--set", setting]
        self.process = None

    def start(self, *settings, wait=True):
        arguments = self.arguments + [a for s in settings for a in ("--set", s)]
        with open(self.folder / "stderr", "w") as errors:
            self.process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=errors,
                                            text=True)
        if wait:
            for line in self.process.stdout:
                if line.startswith("ready"):
                    break
            else:
                raise AssertionError(self.said())
        return self

    def said(self):
        return (self.folder / "stderr").read_text()

    def refuses(self, *settings):
        """Starts and ends by itself; (exit code, what it says)."""
        self.start(*settings, wait=False)
        self.process.communicate(timeout=120)
        return self.process.returncode, self.said()

    def kill(self):
        self.process.kill()
        self.process.communicate()

    def stop(self):
        self.process.terminate()
        self.process.communicate()
        return self.process.returncode

    def client(self, map=""):
        return clearance.Client(self.socket, map=map, connect_timeout_s=30)

    def command(self, *arguments):
        result = subprocess.run([COMMAND, "--server", self.socket, "--json", *arguments],
                                capture_output=True, text=True)
        return result.returncode, json.loads(result.stdout or "{}")

    def log_files(self):
        return sorted((self.folder / "data/maps/default").glob("log-*/*.log"))


def answers(client):
    result = client.query(PROBES)
    return [a.tobytes() for a in (result.distances_m, result.states & 0xbf, result.gradients,
                                  result.object_ids, result.sigmas_m)]


class ProcessTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="clearance_store_")
        self.addCleanup(shutil.rmtree, self.folder, True)
        self.servers = []
        self.addCleanup(self.end_servers)

    def end_servers(self):
        for server in self.servers:
            if server.process and server.process.poll() is None:
                server.kill()

    def server(self, *settings):
        self.servers.append(Server(self.folder, *settings))
        return self.servers[-1]

    def ingest(self, server, first, last):
        with server.client() as client:
            with client.ingest() as stream:
                for k in range(first, last):
                    stream.send(wall_frame(k))
            return stream.acks

    def test_the_python_client_goes_on_across_kills(self):
        server = self.server("store.fsync=each", "store.segment_bytes=40000").start()
        statuses = {}
        with server.client() as client:
            stream = client.ingest()

            def killer():
                rng = random.Random(5)
                for _ in range(3):
                    time.sleep(rng.uniform(0.2, 0.7))
                    server.kill()
                    server.start()

            thread = threading.Thread(target=killer)
            thread.start()
            k = 0
            while thread.is_alive() or k < 20:
                stream.send(wall_frame(k))
                k += 1
                time.sleep(0.01)
            thread.join()
            for ack in stream.finish():
                statuses.setdefault(ack.frame_id, []).append(ack.status)
            info = client.map_info()
        self.assertEqual(info.stamp.revision, k)
        self.assertEqual(info.sources[0].frames_integrated, k)
        self.assertEqual(info.sources[0].last_frame_id, k - 1)
        integrated = ingest_pb2.INGEST_STATUS_INTEGRATED
        self.assertTrue(all(s.count(integrated) <= 1 for s in statuses.values()))
        accepted = sum(ingest_pb2.INGEST_STATUS_ACCEPTED in s for s in statuses.values())
        self.assertGreater(accepted, 0)

    def test_a_second_server_on_the_folder_is_refused(self):
        first = self.server().start()
        second = self.server()
        second.arguments[second.arguments.index("--socket") + 1] += "2"
        code, said = second.refuses()
        self.assertEqual(code, 5)
        self.assertIn(f"process {first.process.pid}", said)
        self.assertEqual(first.stop(), 0)
        second.start()
        self.assertEqual(second.stop(), 0)

    def test_a_cut_segment_loses_what_was_cut_and_says_so(self):
        server = self.server().start()
        self.ingest(server, 0, 6)
        server.kill()
        last = server.log_files()[-1]
        os.truncate(last, last.stat().st_size - 7)
        server.start()
        with server.client() as client:
            self.assertEqual(client.map_info().stamp.revision, 5)
        self.assertIn("cut off", server.said())

    def test_a_damaged_segment_is_refused_unless_told_otherwise(self):
        server = self.server("store.segment_bytes=20000").start()
        self.ingest(server, 0, 12)
        server.kill()
        second = server.log_files()[1]
        damaged = bytearray(second.read_bytes())
        damaged[len(damaged) // 2] ^= 16
        second.write_bytes(damaged)
        code, said = server.refuses()
        self.assertEqual(code, 4)
        self.assertIn(str(second), said)
        server.start("store.recover_damaged=true")
        with server.client() as client:
            revision = client.map_info().stamp.revision
        self.assertTrue(0 < revision < 12)
        self.assertTrue(list(second.parent.glob("*.damaged")))
        # The client's view: it stands where the map stands, and goes on from there.
        self.ingest(server, revision, 12)
        with server.client() as client:
            self.assertEqual(client.map_info().stamp.revision, 12)

    def full_disk(self, server, fill, free):
        self.ingest(server, 0, 4)
        with server.client() as client:
            before = answers(client)
        fill()
        rejected = [a for a in self.ingest(server, 4, 8)
                    if a.status == ingest_pb2.INGEST_STATUS_REJECTED]
        self.assertGreater(len(rejected), 0)
        self.assertEqual(rejected[-1].violations[0].field, "log")
        code, failed = server.command("snapshot", "create", "full")
        self.assertEqual((code, failed["error"]["code"]), (5, "RESOURCE_EXHAUSTED"))
        with server.client() as client:
            if len(rejected) == 4:
                self.assertEqual(answers(client), before)
            else:
                answers(client)
        free()
        self.ingest(server, 8, 12)
        with server.client() as client:
            expected, info = answers(client), client.map_info()
        self.assertEqual(info.stamp.revision, 12 - len(rejected))
        self.assertEqual(server.command("snapshot", "list")[1], {"snapshots": []})
        server.kill()
        server.start()
        with server.client() as client:
            self.assertEqual(answers(client), expected)
            self.assertEqual(client.map_info().stamp.revision, info.stamp.revision)
            self.assertEqual(client.map_info().sources[0].frames_rejected, len(rejected))

    def test_a_file_size_limit_rejects_frames_and_the_service_goes_on(self):
        server = self.server().start()

        def limit(size):
            _, hard = resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE)
            resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (size, hard))

        self.full_disk(server, lambda: limit(server.log_files()[-1].stat().st_size + 5000),
                       lambda: limit(resource.RLIM_INFINITY))

    def test_a_full_disk_rejects_frames_and_the_service_goes_on(self):
        data = pathlib.Path(self.folder) / "data"
        data.mkdir()
        mounted = os.geteuid() == 0 and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(data)],
            stderr=subprocess.DEVNULL).returncode == 0
        if not mounted:
            self.skipTest("a small disk cannot be mounted here")
        self.addCleanup(subprocess.run, ["umount", "-l", str(data)])
        self.addCleanup(self.end_servers)
        server = self.server().start()
        ballast = data / "ballast"

        def fill():
            with open(ballast, "wb", buffering=0) as file:
                try:
                    while True:
                        file.write(b"x" * 4096)
                except OSError:
                    pass

        self.full_disk(server, fill, ballast.unlink)

    def test_snapshots_from_the_command_line(self):
        server = self.server().start()
        self.ingest(server, 0, 5)
        with server.client() as client:
            at_five, epoch = answers(client), client.map_info().stamp.epoch
        code, made = server.command("snapshot", "create", "five", "--comment", "a note")
        self.assertEqual(code, 0, made)
        self.assertEqual((made["snapshot_id"], made["stamp"]["revision"]), ("five", 5))
        self.assertEqual(server.command("snapshot", "create", "five")[0], 4)
        self.assertEqual(server.command("snapshot", "create", "No!")[0], 4)
        self.ingest(server, 5, 9)
        code, made = server.command("snapshot", "create")
        self.assertEqual(code, 0)
        _, listed = server.command("snapshot", "list")
        self.assertEqual([s["snapshot_id"] for s in listed["snapshots"]],
                         [made["snapshot_id"], "five"])
        self.assertEqual(listed["snapshots"][1]["comment"], "a note")
        self.assertEqual(server.command("snapshot", "restore", "six")[0], 3)
        with server.client() as client:
            stream = client.ingest("waits")
            code, restored = server.command("snapshot", "restore", "five")
            self.assertEqual(code, 0, restored)
            self.assertEqual(restored["stamp"]["revision"], 5)
            self.assertNotEqual(restored["stamp"]["epoch"], epoch)
            self.assertEqual(answers(client), at_five)
            # The stream that was open goes on by itself in the new epoch.
            stream.send(wall_frame(1))
            stream.finish()
            self.assertEqual(client.map_info().stamp.revision, 6)
        server.kill()
        server.start()
        with server.client() as client:
            self.assertEqual(client.map_info().stamp.revision, 6)
        self.assertEqual(server.command("snapshot", "delete", "five")[0], 4)
        self.assertEqual(server.command("snapshot", "delete", made["snapshot_id"])[0], 0)
        self.assertEqual(server.command("snapshot", "create", "six")[0], 0)
        self.assertEqual(server.command("snapshot", "delete", "five")[0], 0)
        self.assertEqual(server.command("snapshot", "delete", "five")[0], 3)

    def test_a_damaged_snapshot_is_refused_and_changes_nothing(self):
        server = self.server().start()
        self.ingest(server, 0, 5)
        server.command("snapshot", "create", "good")
        server.command("snapshot", "create", "bad")
        with server.client() as client:
            before, stamp = answers(client), client.map_info().stamp
        folder = server.folder / "data/maps/default/snapshots/bad"
        for file in sorted(folder.iterdir()):
            whole = file.read_bytes()
            if not whole:
                continue
            damaged = bytearray(whole)
            damaged[len(damaged) // 2] ^= 1
            file.write_bytes(damaged)
            code, said = server.command("snapshot", "restore", "bad")
            self.assertEqual((code, said["error"]["code"]), (4, "DATA_LOSS"), file.name)
            file.write_bytes(whole[:-1])
            self.assertEqual(server.command("snapshot", "restore", "bad")[0],
                             0 if file.name == "manifest.json" else 4, file.name)
            file.write_bytes(whole)
            if file.name == "manifest.json":  # a last line without its end is whole
                with server.client() as client:
                    stamp = client.map_info().stamp
        with server.client() as client:
            self.assertEqual(answers(client), before)
            self.assertEqual(client.map_info().stamp.epoch, stamp.epoch)
        self.assertEqual(server.command("snapshot", "restore", "bad")[0], 0)
        with server.client() as client:
            self.assertEqual(answers(client), before)

    def test_without_a_folder_snapshots_say_what_to_set(self):
        server = self.server()
        at = server.arguments.index("--store")
        server.arguments[at + 1] = "none"
        server.start()
        code, said = server.command("snapshot", "create", "x")
        self.assertEqual(code, 4)
        self.assertIn("store.dir", said["error"]["message"])

    def test_restores_tell_open_streams(self):
        server = self.server().start()
        self.ingest(server, 0, 3)
        server.command("snapshot", "create", "three")
        with grpc.insecure_channel("unix:" + server.socket) as channel:
            ended = threading.Event()

            def requests():
                yield ingest_pb2.IngestFramesRequest(open=ingest_pb2.OpenIngest(source_id="s"))
                ended.wait()

            call = ingest_pb2_grpc.IngestServiceStub(channel).IngestFrames(requests())
            self.assertTrue(next(call).HasField("opened"))
            snapshots = snapshot_pb2_grpc.SnapshotServiceStub(channel)
            snapshots.RestoreSnapshot(snapshot_pb2.RestoreSnapshotRequest(snapshot_id="three"))
            closing = next(call)
            self.assertEqual(closing.closing.reason, ingest_pb2.INGEST_CLOSING_REASON_RESTORED)
            with self.assertRaises(grpc.RpcError) as error:
                next(call)
            self.assertEqual(error.exception.code(), grpc.StatusCode.UNAVAILABLE)
            ended.set()


if __name__ == "__main__":
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
