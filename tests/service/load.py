"""What load and TLS cost: load.py SERVER COMMAND SEQUENCE [--seconds 8] [--points 100].

Latency of queries, paced so that they alone are no load, on an idle server and while frames of the
sequence (streamed into a map of their own as fast as they are taken) saturate ingest; the rate of
frames alone and while clients ask as fast as they can; and the same queries over TCP in plain text,
over TLS and over mutual TLS. Medians of --repeats runs; the machine should have nothing else to do.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile


class Server:
    def __init__(self, arguments, folder, *more):
        self.command_path, self.flags = arguments.command, []
        self.process = subprocess.Popen(
            [arguments.server, "--listen", "127.0.0.1:0", "--socket", str(folder / "socket"),
             "--http", "off", "--store", "none", *more], stdout=subprocess.PIPE, text=True)
        for line in self.process.stdout:
            if line.startswith("gRPC on 127.0.0.1"):
                self.address = line.split()[-1]
            if line.startswith("ready"):
                return
        raise SystemExit("the server did not start")

    def start(self, *words):
        return subprocess.Popen([self.command_path, "--server", self.address, *self.flags, "--json",
                                 *words], stdout=subprocess.PIPE, text=True)

    def run(self, *words):
        process = self.start(*words)
        out, _ = process.communicate()
        if process.returncode != 0:
            raise SystemExit(f"{' '.join(words)} ended with {process.returncode}")
        return json.loads(out) if out.strip().startswith("{") else {}

    def stop(self):
        self.process.terminate()
        self.process.communicate()


def certificates(folder):
    def openssl(*words):
        subprocess.run(["openssl", *words], cwd=folder, check=True, stderr=subprocess.DEVNULL)
    new = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    openssl("req", "-x509", *new, "-days", "2", "-subj", "/CN=measured authority", "-keyout",
            "ca.key", "-out", "ca.pem")
    (folder / "names").write_text("subjectAltName=IP:127.0.0.1\n")
    for name in ("server", "client"):
        openssl("req", *new, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out",
                f"{name}.csr")
        openssl("x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
                "-CAcreateserial", "-days", "2", "-extfile", "names", "-out", f"{name}.pem")


def median(runs, key):
    return statistics.median(run["latency"][key] for run in runs)


def show(name, runs, base=None):
    text = f"{name:44s} p50 {median(runs, 'p50_ms'):7.3f}  p99 {median(runs, 'p99_ms'):7.3f} ms"
    if base:
        text += f"   p50 times {median(runs, 'p50_ms') / median(base, 'p50_ms'):.2f}"
    print(text + f"   {statistics.median(r['calls_per_s'] for r in runs):.0f} calls/s", flush=True)


def load(arguments, folder):
    server = Server(arguments, folder)
    server.run("--map", "asked", "ingest", str(arguments.sequence))
    paced = ["--map", "asked", "bench", "query", "--points", str(arguments.points), "--rate", "50",
             "--seconds", str(arguments.seconds)]
    flat_out = ["--map", "asked", "bench", "query", "--points", "1000", "--clients", "4"]
    frames = ["bench", "ingest", "--frames", "60", str(arguments.sequence)]
    idle, loaded, alone, beside = [], [], [], []
    for _ in range(arguments.repeats):
        idle.append(server.run(*paced))
        alone.append(server.run(*frames))
        asking = server.start(*flat_out, "--seconds", str(3 * alone[-1]["seconds"] + 2))
        beside.append(server.run(*frames))
        asking.terminate()
        asking.communicate()
        stop = False
        ingest = server.start(*frames)
        busy = server.start(*paced)
        while not stop:
            try:
                busy.wait(0.05)
                stop = True
            except subprocess.TimeoutExpired:
                if ingest.poll() is not None:
                    ingest.communicate()
                    ingest = server.start(*frames)
        loaded.append(json.loads(busy.communicate()[0]))
        ingest.terminate()
        ingest.communicate()
    server.stop()
    show(f"{arguments.points} points, idle", idle)
    show(f"{arguments.points} points, ingest saturated", loaded, idle)
    rates = [statistics.median(r["frames_per_s"] for r in runs) for runs in (alone, beside)]
    print(f"frames alone {rates[0]:.1f}/s; beside 4 clients asking flat out {rates[1]:.1f}/s "
          f"(times {rates[1] / rates[0]:.2f})", flush=True)


def tls(arguments, folder):
    certificates(folder)
    ca, mine = str(folder / "ca.pem"), [str(folder / "client.pem"), str(folder / "client.key")]
    tls_on = ["--set", f"security.certificate={folder}/server.pem", "--set",
              f"security.key={folder}/server.key"]
    kinds = [("plain text", [], []), ("TLS", tls_on, ["--tls-ca", ca]),
             ("mutual TLS", [*tls_on, "--set", f"security.client_ca={ca}"],
              ["--tls-ca", ca, "--tls-cert", mine[0], "--tls-key", mine[1]])]
    for points in (100, 10_000):
        results = {name: [] for name, _, _ in kinds}
        for _ in range(arguments.repeats):
            for name, flags, client in kinds:
                server = Server(arguments, folder, *flags)
                server.flags = client
                results[name].append(server.run(
                    "bench", "query", "--points", str(points), "--bounds", "-5", "-5", "-1", "5",
                    "5", "1", "--seconds", str(arguments.seconds / 4)))
                server.stop()
        for name, runs in results.items():
            show(f"{points} points over TCP, {name}", runs, results["plain text"])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("server")
    parser.add_argument("command")
    parser.add_argument("sequence", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=8)
    parser.add_argument("--points", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", choices=["load", "tls"])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="clearance_load_") as folder:
        for name, measure in (("load", load), ("tls", tls)):
            if arguments.only in (None, name):
                measure(arguments, pathlib.Path(folder))


if __name__ == "__main__":
    main()
