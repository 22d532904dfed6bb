"""Tables and a summary from what the benchmark programs left in a folder.

report.py FOLDER [--json FILE]
"""
import argparse
import json
import os
import pathlib
import sys


def load(folder, program):
    with open(folder / f"{program}.json", encoding="utf-8") as file:
        return {b["name"].split("/iterations")[0].split("/manual_time")[0]: b
                for b in json.load(file)["benchmarks"]}


def find(results, start):
    """The results whose names begin like this, by the rest of the name."""
    return {name[len(start):]: b for name, b in results.items() if name.startswith(start)}


def table(title, header, rows):
    rows = [[cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in [header] + rows) for i in range(len(header))]
    print(f"\n{title}")
    for row in [header] + rows:
        print("  " + "  ".join(cell.ljust(w) if i == 0 else cell.rjust(w)
                               for i, (cell, w) in enumerate(zip(row, widths))))


def ns(result):
    return result["s_per_point"] * 1e9


def ratio(a, b):
    return a / b if b else None


def print_tables(query, integration, rpc):
    order = ["integrate", "apply", "field", "shapes", "publish", "frame"]
    table("A frame in process, median ms",
          ["sequence, reach of the field"] + order + ["frame p95"],
          [[name] + [b.get(f"{s}_ms", 0) for s in order] + [b["frame_p95_ms"]]
           for name, b in find(integration, "Stages/").items()])
    fine = [(name, sorted(k for k in b if k.endswith("_ms") and k[:-3] not in order + ["frame_p95"]))
            for name, b in find(integration, "Stages/").items()]
    for name, keys in fine:
        if keys:
            b = integration["Stages/" + name]
            table(f"Parts of it: {name}, median ms", ["part", "ms"],
                  [[k[:-3], b[k]] for k in keys])
    table("Growth", ["what", "value"],
          [[f"{name} {key}", b[key]] for start in ("ByMapSize/", "ByRange/")
           for name, b in find(integration, start).items()
           for key in ("frame_ms", "field_ms", "first_frame_ms", "last_frame_ms", "frame_ratio",
                       "first_query_ns", "last_query_ns", "query_ratio") if key in b])
    table("In process, ns a point (1 thread; arguments: reach m / objects)", ["query", "ns"],
          [[name, ns(b)] for name, b in query.items() if "s_per_point" in b])
    table("QueryPoints with gradients, ms", ["call", "p50", "p99", "frames/s beside"],
          [[name, b["p50_ms"], b["p99_ms"], b.get("frames_per_s", "-")]
           for name, b in rpc.items() if "p50_ms" in b])


def summarise(query, integration, rpc, python, peers):
    stages = integration["Stages/street/reach_m:2"]
    far = integration["Stages/street/reach_m:5"]
    octomap, openvdb = peers["OctoMap"], peers["OpenVdb"]
    growth = next(iter(find(integration, "ByMapSize/").values()))
    memory = rpc["IngestAndMemory"]
    random, coherent = ns(query["Random/2/0"]), ns(query["Coherent/2/0"])
    beside = rpc["BesideIngestRandom/points:10000"]
    edges = rpc["BesideIngestEdges"]
    ours = stages["frame_ms"]
    peer = octomap["integrate_ms"] + octomap["field_ms"]
    return {
        # The static map's part: band, free space, fusing.
        "street_integrate_ms":
            stages["integrate_ms"] - stages["objects_ms"] + stages["apply_ms"],
        "street_field_ms": stages["field_ms"],
        "street_field_5m_ms": far["field_ms"],
        # From the decoded frame to the published field.
        "street_publish_ms": ours,
        "street_publish_5m_ms": far["frame_ms"],
        "per_object_ms": stages["per_object_ms"],
        "query_random_ns": random,
        "query_coherent_ns": coherent,
        "query_random_5m_ns": ns(query["Random/5/0"]),
        "query_coherent_5m_ns": ns(query["Coherent/5/0"]),
        "query_objects_10_ratio": ratio(ns(query["Random/2/10"]), random),
        "query_objects_100_ratio": ratio(ns(query["Random/2/100"]), random),
        "query_objects_1000_ratio": ratio(ns(query["Random/2/1000"]), random),
        "rpc_10000_p50_ms": beside["p50_ms"],
        "rpc_10000_p99_ms": beside["p99_ms"],
        "rpc_10000_at_rest_p50_ms": rpc["AtRest/points:10000/unix:0/clients:1"]["p50_ms"],
        "rpc_10000_python_at_rest_p50_ms": python["p50_ms"],
        "rpc_edges_p50_ms": edges["p50_ms"],
        "rpc_edges_p99_ms": edges["p99_ms"],
        "end_to_end_frames_per_s": rpc["BesideIngest20Hz"]["frames_per_s"],
        "bytes_per_voxel": memory["server_growth_bytes"] / stages["known_voxels"],
        "growth_repeats": growth["repeats"],
        "growth_frame_ratio": growth["frame_ratio"],
        "growth_query_ratio": growth["query_ratio"],
        "peers": {
            "octomap_integrate_ms": octomap["integrate_ms"],
            "octomap_dynamicedt3d_field_ms": octomap["field_ms"],
            "octomap_dynamicedt3d_query_ns": octomap["query_ns"],
            "octomap_dynamicedt3d_bytes_per_voxel": octomap["bytes_per_voxel"],
            "openvdb_band_ms": openvdb["band_ms"],
            "openvdb_field_ms": openvdb["field_ms"],
            "openvdb_query_ns": openvdb["query_ns"],
            "openvdb_distance_only_ns": openvdb["distance_only_ns"],
        },
        "ratios": {
            "octomap_frame_over_ours": ratio(peer, ours),
            "openvdb_frame_over_ours": ratio(openvdb["band_ms"] + openvdb["field_ms"], ours),
            "octomap_query_over_ours": ratio(octomap["query_ns"], random),
            "openvdb_query_over_ours": ratio(openvdb["query_ns"], random),
        },
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    programs = {p: load(arguments.folder, f"{p}_benchmark")
                for p in ("query", "integration", "rpc", "peers")}
    with open(arguments.folder / "python_client.json", encoding="utf-8") as file:
        python = json.load(file)
    print_tables(programs["query"], programs["integration"], programs["rpc"])
    summary = summarise(programs["query"], programs["integration"], programs["rpc"], python,
                        programs["peers"])
    print("\nSummary")
    for key, value in summary.items():
        if isinstance(value, dict):
            for name, number in value.items():
                print(f"  {key}.{name}: {number:.4g}")
        else:
            print(f"  {key}: {value:.4g}")
    load_now = os.getloadavg()[0]
    if load_now > os.cpu_count() + 1:
        print(f"\nThe machine is shared: load {load_now:.1f} on {os.cpu_count()} cores. Compare "
              "ratios, not milliseconds.", file=sys.stderr)
    if arguments.json:
        document = {"summary": summary, "load": load_now, "cores": os.cpu_count(),
                    "benchmarks": programs}
        arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
