"""A server under mixed load: soak.py SERVER COMMAND [--minutes 30] [--cycles 1000].

Streams frames as fast as they are taken, asks, edits and snapshots the map meanwhile; then opens
streams and kills their clients. Prints resident memory and threads over time, and ends with 1
where an acknowledgement is missing or memory or threads keep growing.
"""

import argparse
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time

import grpc
import numpy as np

import clearance
from clearance.v1 import admin_pb2, admin_pb2_grpc, ingest_pb2, map_pb2, map_pb2_grpc
from clearance.v1 import snapshot_pb2, snapshot_pb2_grpc

GROWTH = 1.10  # of the second half over the end of the first quarter


def room_frame(k):
    """A room of 6 x 6 x 3 m with an object that circles in it, seen from its middle."""
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 200), np.linspace(-1.2, 1.2, 60))
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                    np.sin(elevation)], axis=-1).reshape(-1, 3)
    distance = np.min(np.array([3, 3, 1.5]) / np.maximum(np.abs(ray), 1e-9), axis=1)
    centre = 2 * np.array([np.cos(0.05 * k), np.sin(0.05 * k), 0])
    along = ray @ centre
    reach = along**2 - (4 - 0.3**2)
    hit = (reach > 0) & (along > 0)
    distance[hit] = along[hit] - np.sqrt(reach[hit])
    motion = [clearance.object_motion(3, world_from_object=clearance.pose(centre))]
    return clearance.cloud_frame(k, 10**9 + k * 10**8, clearance.pose([0, 0, 0]),
                                 ray * distance[:, None], np.where(hit, 3, 0), motion)


class Soak:
    def __init__(self, server, command):
        self.command = command
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="clearance_soak_"))
        self.socket = str(self.folder / "socket")
        self.log = open(self.folder / "log", "w")
        self.process = subprocess.Popen(
            [server, "--listen", "127.0.0.1:0", "--socket", self.socket, "--http", "off", "--store",
             str(self.folder / "data"), "--set", "store.snapshot_period_s=20", "--set",
             "store.segment_bytes=16777216"], stdout=self.log, stderr=self.log)
        self.channel = grpc.insecure_channel("unix:" + self.socket)
        grpc.channel_ready_future(self.channel).result(60)
        self.admin = admin_pb2_grpc.AdminServiceStub(self.channel)
        self.end = threading.Event()
        self.errors, self.counts = [], {"frames": 0, "queries": 0, "edits": 0, "snapshots": 0}

    def close(self):
        self.process.terminate()
        code = self.process.wait()
        shutil.rmtree(self.folder)
        return code

    def guarded(self, work):
        try:
            work()
        except Exception as error:
            self.errors.append(f"{work.__name__}: {error!r}")
            self.end.set()

    def ingest(self):
        k = 0
        while not self.end.is_set():
            with clearance.Client(self.socket) as client:
                with client.ingest() as stream:
                    first = k
                    while not self.end.is_set() and k < first + 200:
                        stream.send(room_frame(k))
                        k += 1
                done = {a.frame_id for a in stream.acks
                        if a.status == ingest_pb2.INGEST_STATUS_INTEGRATED}
                missing = set(range(first, k)) - done
                if missing:
                    raise AssertionError(f"no acks of {sorted(missing)[:5]}")
                self.counts["frames"] = k

    def query(self):
        rng = np.random.default_rng(1)
        with clearance.Client(self.socket) as client:
            while not self.end.is_set():
                client.query(rng.uniform(-3, 3, (1000, 3)))
                self.counts["queries"] += 1

    def edit(self):
        maps = map_pb2_grpc.MapServiceStub(self.channel)
        snapshots = snapshot_pb2_grpc.SnapshotServiceStub(self.channel)
        while not self.end.wait(1.0):
            request = map_pb2.EditRegionRequest(action=map_pb2.EDIT_ACTION_MARK_FREE)
            request.sphere.center.x_m = random.uniform(-2, 2)
            request.sphere.radius_m = 0.4
            maps.EditRegion(request, timeout=60)
            self.counts["edits"] += 1
            if self.counts["edits"] % 15 == 0:
                made = snapshots.CreateSnapshot(snapshot_pb2.CreateSnapshotRequest(), timeout=120)
                snapshots.DeleteSnapshot(snapshot_pb2.DeleteSnapshotRequest(
                    snapshot_id=made.snapshot.snapshot_id), timeout=60)
                self.counts["snapshots"] += 1

    def stats(self):
        stats = self.admin.GetStats(admin_pb2.GetStatsRequest(), timeout=60)
        return stats.resident_bytes, stats.threads, stats.open_streams

    def watch(self, seconds, done=lambda: False):
        samples, started, shown = [], time.monotonic(), 0
        while time.monotonic() - started < seconds and not self.end.is_set() and not done():
            time.sleep(min(2.0, seconds / 50))
            samples.append(self.stats())
            if time.monotonic() - shown > 60:
                shown = time.monotonic()
                print(f"{shown - started:6.0f} s  RSS {samples[-1][0] / 1e6:7.1f} MB  threads "
                      f"{samples[-1][1]:3d}  streams {samples[-1][2]:2d}  {self.counts}",
                      flush=True)
        return samples

    def judge(self, name, samples):
        def peak(part, i):
            return max(s[i] for s in part)

        early, late = samples[:len(samples) // 4], samples[len(samples) // 2:]
        for i, what, slack in ((0, "RSS", 8e6), (1, "threads", 3)):
            if peak(late, i) > GROWTH * peak(early, i) + slack:
                self.errors.append(f"{name}: {what} grew from {peak(early, i)} to {peak(late, i)}")
        print(f"{name}: RSS {peak(early, 0) / 1e6:.1f} MB early, {peak(late, 0) / 1e6:.1f} MB late; "
              f"threads {peak(early, 1)}, {peak(late, 1)}", flush=True)

    def mixed(self, minutes):
        threads = [threading.Thread(target=self.guarded, args=(work,))
                   for work in (self.ingest, self.query, self.query, self.edit)]
        for thread in threads:
            thread.start()
        samples = self.watch(minutes * 60)
        self.end.set()
        for thread in threads:
            thread.join()
        self.end.clear()
        self.judge(f"{minutes:g} min of mixed load, {self.counts}", samples)

    def connect_and_kill(self, cycles):
        """Clients that die in the middle of a call, most of them with an open stream."""
        code = ("import sys, time; import clearance; c = clearance.Client(sys.argv[1]); "
                "s = c.ingest('killed'); print('open', flush=True); time.sleep(60)")
        samples = []
        for cycle in range(cycles):
            if cycle % 20 == 0:
                child = subprocess.Popen([sys.executable, "-c", code, self.socket],
                                         stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
                child.stdout.readline()
            else:
                child = subprocess.Popen([self.command, "--server", self.socket, "query", "1", "1",
                                          "1"], stdout=subprocess.DEVNULL,
                                         stderr=subprocess.DEVNULL)
                time.sleep(random.uniform(0.0, 0.02))
            child.kill()
            child.communicate()
            if cycle % max(1, cycles // 50) == 0:
                samples.append(self.stats())
        time.sleep(1)
        samples.append(self.stats())
        self.judge(f"{cycles} clients connected and killed", samples)
        if samples[-1][2] != 0:
            self.errors.append(f"{samples[-1][2]} streams are still open")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("server")
    parser.add_argument("command")
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--cycles", type=int, default=1000)
    arguments = parser.parse_args()
    soak = Soak(arguments.server, arguments.command)
    soak.mixed(arguments.minutes)
    if not soak.errors:
        soak.connect_and_kill(arguments.cycles)
    code = soak.close()
    if code != 0:
        soak.errors.append(f"the server ended with {code}")
    for error in soak.errors:
        print("FAILED:", error)
    sys.exit(1 if soak.errors else 0)


if __name__ == "__main__":
    main()
