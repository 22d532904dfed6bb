"""The results as tables: each is one experiment."""
from dataclasses import dataclass, field

import targets


@dataclass
class Table:
    name: str     # of its CSV
    title: str
    note: str
    header: list
    rows: list = field(default_factory=list)


def _number(value, digits=3):
    if value is None or value == "":
        return "-"
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def _percent(value, digits=2):
    return "-" if value is None else f"{100 * value:.{digits}f} %"


def _error_cells(e):
    return [str(e["points"])] + [_number(e[k]) for k in ("bias", "mean", "median", "p95", "p99", "max")]


ERROR_HEADER = ["points", "bias", "mean", "median", "p95", "p99", "max"]


def goals(results):
    table = Table("targets", "Targets", "Every value with a target, judged by the program. Peers were measured on "
                  "another day on the like of this machine; the paper's figures are of its own data.",
                  ["what", "where", "measured", "target", "", "paper, peers", "note"])
    table.rows = [j.row() for j in targets.judge(results)]
    return table


def objects(results):
    table = Table("objects", "Object meshes (experiments 1 to 3)",
                  "At the last frame. r_cov: share of the true surface with a vertex within half a voxel times "
                  "sqrt(3); surface: with a triangle so near; visible: over what was ever in view. The paper: r_cov "
                  "0.961 (a vehicle seen from all sides), RMSE 0.12, 0.17 and 0.14 m (seen in passing).",
                  ["recording", "object", "frames in view", "ever visible", "r_cov", "r_cov visible", "surface",
                   "surface visible", "RMSE m", "p95 m"])
    for name, r in results["recordings"].items():
        for o in r.get("objects", []):
            cells = [o["error"]] + [""] * 6 if "error" in o else [
                _number(o[k]) for k in ("visible_share", "r_cov", "r_cov_visible", "r_cov_surface",
                                        "r_cov_surface_visible", "rmse_m", "p95_m")]
            table.rows.append([name, str(o["object"]), str(o["frames_in_view"]), *cells])
    return table


def coverage(results):
    table = Table("coverage", "", "", ["recording", "object", "frame", "frames_in_view", "vertices", "visible_share",
                                       "r_cov", "r_cov_visible", "r_cov_surface", "r_cov_surface_visible", "rmse_m"])
    for name, r in results["recordings"].items():
        for row in r.get("coverage", []):
            if "error" not in row:
                table.rows.append([name] + [_number(row[k], 5) for k in table.header[1:]])
    return table


def free_space(results):
    table = Table("free_space", "Free space (experiment 4)",
                  "The 1 m slab around the lidar. TP: free in both; FN: free, called occupied; FP: contains surface, "
                  "called free; shares of the truly free. The paper: TP 0.68 and 0.92, FN 0.3 % and 0.03 %, FP 1.6 % "
                  "and 0.5 % in its two halls.",
                  ["recording", "confidence", "truth", "TP", "FN", "FP", "unknown"])
    for name, r in results["recordings"].items():
        f = r.get("free_space")
        if not f:
            continue
        truth, fn = str(f["truth_free"]), f"{f['FN']} ({_percent(f['FN_share'], 3)})"
        high, low = (f["TP_high"], f["FP_high"]), (f["TP"] - f["TP_high"], f["FP"] - f["FP_high"])
        for confidence, (tp, fp) in (("high", high), ("low", low), ("both", (f["TP"], f["FP"]))):
            n = max(f["truth_free"], 1)
            table.rows.append([name, confidence, truth, f"{tp} ({tp / n:.3f})", fn, f"{fp} ({_percent(fp / n)})",
                               str(f["unobserved"])])
    return table


def times(results):
    table = Table("times", "Time (experiment 5)",
                  "Milliseconds. In process: the static map's part of integration (free space included), each object's "
                  "part, fusing, the distance field to 5 m, each object's mesh. Server: from a frame's arrival at the "
                  "map to its publication. The paper: 45 ms static, 10 ms an object, without a distance field.",
                  ["recording", "step", "number", "median", "p95"])
    names = {"static": "integration, static", "object": "integration, an object", "apply": "fusing",
             "field": "distance field", "shapes": "object shapes", "mesh": "mesh of an object",
             "all stages": "frame, all steps but meshes"}
    for name, r in results["recordings"].items():
        stages = r.get("stage_times", {})
        rows = [(title, stages[key]) for key, title in names.items() if key in stages]
        t = r.get("times", {})
        rows += [(title, t[key]) for key, title in (("frame", "server, a frame"), ("mesh", "server, a mesh export"))
                 if key in t]
        for title, s in rows:
            table.rows.append([name, title, str(s["count"]), _number(s["p50_ms"], 1), _number(s["p95_ms"], 1)])
    return table


def distances(results):
    table = Table("distances", "Distances (experiment 6)",
                  "|Error| in voxels where the nearest true surface was observed (share stated), to 5 m. static: on "
                  "recorded rays, static map alone. Objects: within 2 m of what was in view at the end; boxes are the "
                  "true shapes' own. Ahead: against the true future, and against the true twist of the last frame kept "
                  "up. weighted: the same points with FUSION_WEIGHTED. Gradient: angle to the exact one.",
                  ["recording", "truth", "where", "observed", *ERROR_HEADER, "gradient median", "gradient p95",
                   "called occupied", "unknown"])

    def add(name, truth, where, e):
        if e.get("points"):
            angles = [f"{e[k]:.1f} deg" if k in e else "-" for k in ("gradient_median_deg", "gradient_p95_deg")]
            table.rows.append([name, truth, where, f"{e['observed_share']:.2f}", *_error_cells(e), *angles,
                               _percent(e["called_occupied"]), _percent(e["unknown"])])
    for name, r in results["recordings"].items():
        add(name, "static", "open space", r.get("static", {}))
        for h, truths in r.get("near_objects", {}).items():
            for truth, regions in truths.items():
                when = "now" if h == "0" else f"{h} s ahead"
                for where, e in regions.items():
                    add(name, f"{when}, {truth}", where, e)
    return table


def occupied(results):
    table = Table("truly_occupied", "Truly occupied space (experiment 6)",
                  "Voxels whose cube contains true surface, within the sensor's range, by what they are called; shares "
                  "of all, and of those with a known state. observed: a return lies within half a voxel of the "
                  "middle. Free at high confidence is the mistake that must be rarest.",
                  ["recording", "surface", "voxels", "known", "occupied", "free, low confidence",
                   "free, high confidence"])
    for name, r in results["recordings"].items():
        for what, o in r.get("truly_occupied", {}).items():
            table.rows.append([name, what, str(o["truly_occupied"]), str(o["known"]), str(o["occupied"]),
                               *(f"{o[c]} ({_percent(o[c + '_share'], d)}, {_percent(o[c + '_share_of_known'], d)})"
                                 for c, d in (("free_low", 3), ("free_high", 4)))])
    return table


def ghosts(results):
    table = Table("ghosts", "Ghosts (experiment 6)",
                  "Voxels that objects swept, at least a voxel from static surfaces, with three or more later rays "
                  "through them: none may be occupied in the static map. Parked: one car parks, one that stood drives "
                  "off, one stops and goes on; without labels while they stand.",
                  ["recording", "labels", "swept", "away from static", "seen again", "free", "unknown", "ghosts"])
    for name, r in results["recordings"].items():
        for title, g in r.get("ghosts", {}).items():
            table.rows.append([name, title] + [str(g[k]) for k in ("swept", "away_from_static", "seen_again", "free",
                                                                   "unknown", "ghosts")])
    return table


def returns(results):
    table = Table("returns", "Returns of the last frames",
                  "Distances answered where static returns of the last ten frames lie, which ought to be zero, in "
                  "voxels: for recordings without exact truth, too.",
                  ["recording", *ERROR_HEADER, "free, low", "free, high", "unknown"])
    for name, r in results["recordings"].items():
        e = r.get("returns", {})
        if e.get("points"):
            table.rows.append([name, *_error_cells(e), _percent(e["free_low_share"], 3),
                               _percent(e["free_high_share"], 4), _percent(e["unknown"])])
    return table


def robustness(results):
    table = Table("robustness", "Robustness (experiment 6)",
                  "The same recording as a worse front end would deliver it; at most 100 frames. Meshes: means over "
                  "objects with ten frames in view. Errors in voxels.",
                  ["recording", "variant", "violations", "RMSE m", "surface visible", "static mean", "static p95",
                   "near objects now", "1 s ahead", "occupied called free, low", "high", "ghosts",
                   "last returns, median", "p95"])
    for name, variants in results.get("robustness", {}).items():
        for title, r in variants.items():
            if "error" in r:
                table.rows.append([name, title, r["error"]] + [""] * 11)
                continue
            good = [o for o in r.get("objects", []) if o["frames_in_view"] >= targets.LEAST_FRAMES and
                    o.get("rmse_m") is not None]
            mean = [sum(o[k] for o in good) / len(good) if good else None for k in ("rmse_m", "r_cov_surface_visible")]
            near = r.get("near_objects", {})
            now = near.get("0", {}).get("true motion", {}).get("all", {})
            ahead = near.get("1", {}).get("constant twist", {}).get("all", {})
            static, o = r.get("static", {}), r.get("truly_occupied", {}).get("static", {})
            table.rows.append([name, title, str(r["times"]["violations"]), *map(_number, mean),
                               _number(static.get("mean")), _number(static.get("p95")), _number(now.get("mean")),
                               _number(ahead.get("mean")), _percent(o.get("free_low_share"), 3),
                               _percent(o.get("free_high_share"), 4), _number(r.get("ghosts", {}).get("ghosts")),
                               _number(r["returns"].get("median")), _number(r["returns"].get("p95"))])
    return table


def ablations(results):
    table = Table("ablations", "Ablations (experiment 7): whole frames",
                  "First frames of a recording with one choice changed. Field: |error| of the static distance in "
                  "voxels on the same points. Meshes: means over all objects in view.",
                  ["recording", "noise m", "variant", "field mean", "p95", "p99", "RMSE m", "surface visible",
                   "integration ms"])
    for name, runs in results.get("ablations", {}).items():
        for run in runs:
            for title, r in run["variants"].items():
                good = [o for o in r.get("objects", []) if o.get("rmse_m") is not None]
                mean = [sum(o[k] for o in good) / len(good) if good else None
                        for k in ("rmse_m", "r_cov_surface_visible")]
                table.rows.append([name, f"{run['noise_m']:g}", title] +
                                  [_number(r["field"].get(k)) for k in ("mean", "p95", "p99")] +
                                  [*map(_number, mean), _number(r["integrate_ms"], 1)])
                for sites in ("sub-voxel sites", "voxel centres as sites"):
                    if sites in r:
                        table.rows.append([name, f"{run['noise_m']:g}", f"nearest site, {sites}"] +
                                          [_number(r[sites].get(k)) for k in ("mean", "p95", "p99")] + ["", "", ""])
    return table


def bands(results):
    table = Table("local_fields", "Ablations: one local field in the surface band",
                  "Analytic scenes, one view, points within two voxels. foot: distance to the field's nearest surface "
                  "point; reverting: the kernel's inverse. |Error| in voxels.",
                  ["kernel", "length, voxels", "neighbourhood", "foot bias", "foot mean", "foot p95", "reverting bias",
                   "reverting mean", "reverting p95"])
    for row in results.get("local_fields", {}).get("band", []):
        n = row["neighbourhood"]
        cells = [_number(row[w].get(k)) for w in ("foot", "reverting") for k in ("bias", "mean", "p95")]
        table.rows.append([row["kernel"], _number(row["length_voxels"], 1), f"{n}x{n}x{n}", *cells])
    return table


def training(results):
    table = Table("training", "Ablations: cost of a neighbourhood", "Training one field in double precision.",
                  ["points", "microseconds"])
    table.rows = [[str(r["points"]), _number(r["median_us"], 1)]
                  for r in results.get("local_fields", {}).get("training", [])]
    return table


def frustum(results):
    table = Table("direct_estimate", "Ablations: direct estimate against closest site",
                  "Points throughout the view, by their true distance; |error| in voxels. Direct: the reverting distance "
                  "in double precision of the field around the nearest training point, found by an exact search; leaf: "
                  "of the 8x8x8 leaf whose middle is nearest. closest: distance to that nearest point itself. No "
                  "answer: the latent underflows, in double or in single precision.",
                  ["length, voxels", "true distance m", "points", "direct mean", "direct p95", "leaf mean", "leaf p95",
                   "no answer", "in floats", "closest mean", "closest p95"])
    for r in results.get("local_fields", {}).get("frustum", []):
        cells = [_number(r[w].get(k)) for w in ("direct", "leaf") for k in ("mean", "p95")]
        table.rows.append([_number(r["length_voxels"], 1), f"{r['from_m']:g} to {r['to_m']:g}",
                           str(r["closest_site"]["points"]), *cells, _percent(r["no_answer"], 1),
                           _percent(r["no_answer_in_floats"], 1), _number(r["closest_site"].get("mean")),
                           _number(r["closest_site"].get("p95"))])
    return table


ALL = (goals, objects, free_space, times, distances, occupied, ghosts, returns, robustness, ablations, bands,
       training, frustum)
