"""The summary from what Google Benchmark writes."""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

REPORT = pathlib.Path(__file__).parent / "report.py"


def programs():
    stages = {"integrate_ms": 11, "objects_ms": 1, "per_object_ms": 0.5, "apply_ms": 2, "field_ms": 8, "shapes_ms": 1, "publish_ms": 1,
              "frame_ms": 22, "frame_p95_ms": 30, "known_voxels": 1e6}
    call = {"p50_ms": 1, "p99_ms": 3, "frames_per_s": 30}
    return {
        "query": {f"{kind}/{reach}/{n}": {"s_per_point": 1e-7 * (1 + n / 10)}
                  for kind in ("Random", "Coherent") for reach in (2, 5)
                  for n in (0, 10, 100, 1000)},
        "integration": {
            "Stages/street/reach_m:2/iterations:1": stages,
            "Stages/street/reach_m:5/iterations:1": dict(stages, field_ms=20),
            "ByMapSize/street/iterations:1": {"repeats": 10, "frame_ratio": 1.1,
                                              "query_ratio": 1.05}},
        "rpc": {
            "IngestAndMemory/iterations:1/manual_time": {"server_growth_bytes": 5e7},
            "AtRest/points:10000/unix:0/clients:1/manual_time": dict(call, p50_ms=0.7),
            "BesideIngestRandom/points:10000/iterations:60/manual_time": dict(call, p50_ms=2.5),
            "BesideIngestEdges/iterations:60/manual_time": call,
            "BesideIngest20Hz/iterations:60/manual_time": call},
        "peers": {
            "OctoMap/iterations:1": {"integrate_ms": 800, "field_ms": 300, "query_ns": 140,
                                     "bytes_per_voxel": 170},
            "OpenVdb/iterations:1": {"band_ms": 400, "field_ms": 200, "query_ns": 600,
                                     "distance_only_ns": 200}}}


class ReportTest(unittest.TestCase):
    def test_summary_has_the_figures_and_the_peers_beside_them(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            for program, results in programs().items():
                rows = [dict(counters, name=n) for n, counters in results.items()]
                (folder / f"{program}_benchmark.json").write_text(json.dumps({"benchmarks": rows}))
            (folder / "python_client.json").write_text('{"p50_ms": 2.0, "p99_ms": 3.0}')
            run = subprocess.run([sys.executable, "-B", REPORT, folder, "--json",
                                  folder / "out.json"], check=True, capture_output=True, text=True)
            summary = json.loads((folder / "out.json").read_text())["summary"]
        self.assertIn("street", run.stdout)
        for key, value in {"street_integrate_ms": 12, "street_field_5m_ms": 20,
                           "street_publish_ms": 22, "per_object_ms": 0.5, "query_random_ns": 100,
                           "query_coherent_ns": 100, "query_objects_10_ratio": 2,
                           "rpc_10000_p50_ms": 2.5, "bytes_per_voxel": 50,
                           "growth_frame_ratio": 1.1}.items():
            self.assertAlmostEqual(summary[key], value, msg=key)
        self.assertAlmostEqual(summary["ratios"]["octomap_frame_over_ours"], 50)
        self.assertAlmostEqual(summary["peers"]["openvdb_query_ns"], 600)


if __name__ == "__main__":
    unittest.main()
