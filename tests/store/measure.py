"""Times of the frame log and of snapshots: measure.py SERVER COMMAND SEQUENCE [--voxel V] [--big].

Prints what ingesting the sequence costs without a log and with one for each fsync policy (processor
time of the server, which a busy machine changes least, and wall time), how fast the log replays
compared with the recorded rate, and how long a snapshot takes to write, to restore and to start
from. --big grows the map (a finer voxel size) until its snapshot is about 500 MB.
"""

import argparse
import json
import pathlib
import shutil
import statistics
import subprocess
import tempfile
import time


class Server:
    def __init__(self, arguments, folder, voxel, store, fsync="interval"):
        self.command_path = arguments.command
        self.socket = str(folder / "socket")
        self.arguments = [arguments.server, "--listen", "127.0.0.1:0", "--socket", self.socket,
                          "--http", "off", "--set", f"map.voxel_size_m={voxel}", "--store",
                          str(folder / "data") if store else "none", "--set",
                          f"store.fsync={fsync}"]

    def start(self):
        """Seconds until it serves."""
        started = time.monotonic()
        self.process = subprocess.Popen(self.arguments, stdout=subprocess.PIPE, text=True)
        for line in self.process.stdout:
            if line.startswith("ready"):
                return time.monotonic() - started
        raise SystemExit("the server did not start")

    def processor_s(self):
        fields = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / 100

    def command(self, *arguments):
        result = subprocess.run([self.command_path, "--server", self.socket, "--json", "--timeout",
                                 "600", *arguments], capture_output=True, text=True, check=True)
        return json.loads(result.stdout)

    def ingest(self, sequence, map="default"):
        """(processor seconds of the server, wall seconds)."""
        before, started = self.processor_s(), time.monotonic()
        subprocess.run([self.command_path, "--server", self.socket, "--map", map, "ingest",
                        str(sequence)], check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)
        return self.processor_s() - before, time.monotonic() - started

    def kill(self):
        self.process.kill()
        self.process.communicate()


def recorded_s(sequence):
    stamps = [float(line.split()[0]) for line in (sequence / "trajectory.tum").open()
              if line.strip() and not line.startswith("#")]
    return stamps[-1] - stamps[0]


def log_overhead(arguments, work):
    runs = {}
    for repeat in range(arguments.repeats):
        for name, store, fsync in (("no log", False, "off"), ("fsync off", True, "off"),
                                   ("fsync interval", True, "interval"),
                                   ("fsync each", True, "each")):
            folder = pathlib.Path(tempfile.mkdtemp(dir=work))
            server = Server(arguments, folder, arguments.voxel, store, fsync)
            server.start()
            runs.setdefault(name, []).append(server.ingest(arguments.sequence))
            server.kill()
            shutil.rmtree(folder)
    base = [statistics.median(r[i] for r in runs["no log"]) for i in (0, 1)]
    for name, values in runs.items():
        processor, wall = (statistics.median(v[i] for v in values) for i in (0, 1))
        print(f"ingest, {name:15s} processor {processor:6.2f} s ({processor / base[0] - 1:+6.1%})"
              f"   wall {wall:6.2f} s ({wall / base[1] - 1:+6.1%})", flush=True)


def replay(arguments, work):
    folder = pathlib.Path(tempfile.mkdtemp(dir=work))
    server = Server(arguments, folder, arguments.voxel, True)
    empty_s = server.start()
    server.ingest(arguments.sequence, "replayed")
    server.kill()
    recorded = recorded_s(arguments.sequence)
    times, used = [], []
    for _ in range(arguments.repeats):
        times.append(server.start() - empty_s)
        used.append(server.processor_s())
        server.kill()
    seconds, processor = statistics.median(times), statistics.median(used)
    print(f"replay: {recorded:.1f} s of frames in {seconds:.2f} s wall, {recorded / seconds:.1f} "
          f"times the recorded rate; processor {processor:.2f} s", flush=True)


def snapshots(arguments, work, voxel):
    folder = pathlib.Path(tempfile.mkdtemp(dir=work))
    server = Server(arguments, folder, voxel, True)
    empty_s = server.start()
    server.command("map", "create", "big", "--voxel-size-m", str(voxel))
    server.ingest(arguments.sequence, "big")
    started = time.monotonic()
    made = server.command("--map", "big", "snapshot", "create", "measured")
    written = time.monotonic() - started
    times = []
    for _ in range(arguments.repeats):
        started = time.monotonic()
        server.command("--map", "big", "snapshot", "restore", "measured")
        times.append(time.monotonic() - started)
    server.kill()
    start = server.start() - empty_s
    server.kill()
    size = made["total_bytes"]
    print(f"snapshot: {size / 1e6:.0f} MB written in {written:.2f} s, restored in "
          f"{statistics.median(times):.2f} s ({min(times):.2f} to {max(times):.2f}), started from "
          f"in {start:.2f} s", flush=True)
    shutil.rmtree(folder)
    return size


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("server")
    parser.add_argument("command")
    parser.add_argument("sequence", type=pathlib.Path)
    parser.add_argument("--voxel", type=float, default=0.2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--big", action="store_true")
    parser.add_argument("--only", choices=["overhead", "replay", "snapshot"])
    arguments = parser.parse_args()
    work = tempfile.mkdtemp(prefix="clearance_measure_")
    try:
        if arguments.only in (None, "overhead"):
            log_overhead(arguments, work)
        if arguments.only in (None, "replay"):
            replay(arguments, work)
        if arguments.only in (None, "snapshot"):
            voxel = arguments.voxel
            size = snapshots(arguments, work, voxel)
            while arguments.big and size < 450e6:
                voxel *= max(0.5, (500e6 / size) ** (-1 / 3))
                size = snapshots(arguments, work, voxel)
    finally:
        shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    main()
