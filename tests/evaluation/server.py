"""A server of our own and the `clearance` command as its client."""
import json
import pathlib
import subprocess
import tempfile
import time

import numpy as np

_STATES = {"unknown": 0, "free": 1, "occupied": 2}


class Server:
    """Starts clearance_server on a unix socket of its own; stops it at the end of the with block."""

    def __init__(self, build, root):
        self._bin, self._root = pathlib.Path(build) / "bin", pathlib.Path(root)

    def __enter__(self):
        self._folder = tempfile.TemporaryDirectory()
        self._scratch = pathlib.Path(self._folder.name)
        self._log = open(self._scratch / "server.log", "w+")
        self.address = f"unix:{self._scratch}/clearance.sock"
        self._process = subprocess.Popen(
            [str(self._bin / "clearance_server"), "--config", str(self._root / "server/config/default.yaml"),
             "--listen", "127.0.0.1:0", "--socket", f"{self._scratch}/clearance.sock", "--http", "off"],
            stdout=self._log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
        try:
            self._wait_until_ready()
        except Exception:
            self.__exit__()
            raise
        return self

    def _wait_until_ready(self):
        log = self._scratch / "server.log"
        for _ in range(300):
            if "ready\n" in log.read_text():
                return
            if self._process.poll() is not None:
                break
            time.sleep(.1)
        raise RuntimeError(f"the server did not start: {log.read_text()}")

    def __exit__(self, *_):
        self._process.terminate()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
        self._folder.cleanup()

    def command(self, map_id, *arguments):
        """Runs `clearance` on a map and returns what it prints; its error text where it fails."""
        done = subprocess.run([str(self._bin / "clearance"), "--server", self.address, "--map", map_id,
                               "--timeout", "600", *map(str, arguments)],
                              capture_output=True, text=True, stdin=subprocess.DEVNULL)
        if done.returncode != 0:
            raise RuntimeError(f"clearance {' '.join(map(str, arguments))}: exit {done.returncode}: "
                               f"{done.stderr.strip() or done.stdout.strip()}")
        return done.stdout

    def ingest(self, map_id, folder):
        """Streams a sequence folder as fast as it is acknowledged; the summary of `clearance ingest`."""
        return json.loads(self.command(map_id, "--json", "ingest", folder, "--rate", "max"))

    def query(self, map_id, points, horizon_s=0.0, static_only=False):
        """Distances [n], states [n] (0 unknown, 1 free, 2 occupied), object ids [n], low confidence [n]."""
        if len(points) == 0:
            return np.zeros(0), np.zeros(0, int), np.zeros(0, int), np.zeros(0, bool)
        asked, answered = self._scratch / "points.csv", self._scratch / "answers.csv"
        np.savetxt(asked, points, delimiter=",", fmt="%.9f", header="x,y,z", comments="")
        arguments = ["query", "--points", asked, "--out", answered, "--horizon", horizon_s]
        self.command(map_id, *arguments, *(["--static-only"] if static_only else []))
        rows = [line.split(",") for line in answered.read_text().splitlines()[1:]]
        if len(rows) != len(points):
            raise RuntimeError(f"asked {len(points)} points, got {len(rows)} answers")
        return (np.array([float(r[3]) for r in rows]), np.array([_STATES[r[4]] for r in rows]),
                np.array([int(r[9]) for r in rows]), np.array(["low_confidence" in r[5] for r in rows]))

    def mesh(self, map_id, object_id, path):
        """Writes an object's mesh in the world frame at the map's stamp."""
        self.command(map_id, "mesh", "--object", object_id, "--out", path)

    def delete(self, map_id):
        self.command(map_id, "map", "delete")
