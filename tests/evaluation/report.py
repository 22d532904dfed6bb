"""Turns the measures into Markdown tables, beside what they should reach."""

TARGETS = {"rmse_m": 0.06, "surface_visible": 0.95, "orbit_visible": 0.97, "mean": 0.15, "p99": 0.5}


def _number(value, digits=3):
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def _table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _section(title, note, header, rows):
    return f"## {title}\n{note}\n\n{_table(header, rows)}\n" if rows else ""


def _ingest(results):
    rows = []
    for name, r in results.items():
        i = r.get("ingest", {})
        if i:
            rows.append([name, str(r["frames"]), _number(r["voxel_m"], 2), _number(i.get("frames_per_s"), 1),
                         _number(i.get("integrate_ms_p50"), 1), _number(i.get("integrate_ms_p95"), 1),
                         str(i.get("rejected")), str(i.get("violations"))])
    return _section("Streaming", "As fast as acknowledged, distance field included.",
                    ["recording", "frames", "voxel m", "frames/s", "ms median", "ms p95", "rejected",
                     "violations"], rows)


def _objects(results):
    rows = []
    for name, r in results.items():
        for o in r.get("objects", []):
            if "error" in o:
                rows.append([name, str(o["object"]), str(o["frames_in_view"]), o["error"]] + [""] * 6)
                continue
            good = (o["rmse_m"] is not None and o["rmse_m"] <= TARGETS["rmse_m"] and
                    (o["r_cov_surface_visible"] or 0) >= TARGETS["surface_visible"])
            rows.append([name, str(o["object"]), str(o["frames_in_view"]), _number(o["rmse_m"]),
                         _number(o["p95_m"])] +
                        [_number(o[k]) for k in ("r_cov", "r_cov_visible", "r_cov_surface",
                                                 "r_cov_surface_visible")] +
                        ["-" if not o["judged"] else "yes" if good else "no"])
    note = (f"Against the true shapes at the last frame. Reached: RMSE <= {TARGETS['rmse_m']} m and coverage of "
            f"the visible surface by triangles >= {TARGETS['surface_visible']}; judged from 10 frames in view on.")
    return _section("Object meshes", note,
                    ["recording", "object", "frames", "RMSE m", "p95 m", "r_cov", "r_cov visible",
                     "r_cov surface", "r_cov surface visible", "reached"], rows)


def _ghosts(results):
    rows = [[name, title] + [str(g[k]) for k in ("swept", "away_from_static", "seen_again", "free", "unknown",
                                                 "ghosts")]
            for name, r in results.items() for title, g in r.get("ghosts", {}).items()]
    return _section("Ghosts", "Voxels that objects swept, at least a voxel from static surfaces, with three or more "
                    "later rays through them: none may be occupied in the static map.",
                    ["recording", "labels", "swept", "away from static", "seen again", "free", "unknown",
                     "ghosts"], rows)


def _errors(results):
    rows = []
    for name, r in results.items():
        measures = [("static", r["static"])] if "static" in r else []
        measures += [(f"within 2 m of objects, {h} s ahead", e) for h, e in r.get("near_objects", {}).items()]
        for title, e in measures:
            if e.get("points"):
                rows.append([name, title, str(e["points"]), f"{e['observed_share']:.2f}"] +
                            [_number(e[k]) for k in ("bias", "mean", "median", "p95", "p99", "max")] +
                            [f"{e['called_occupied']:.2%}", f"{e['unknown']:.2%}"])
            else:
                rows.append([name, title, "0"] + [""] * 9)
    note = (f"|Error| of the distance in voxels, to 5 m, where the nearest true surface was observed (share stated). "
            f"Analytic scenes should reach mean <= {TARGETS['mean']}, p99 <= {TARGETS['p99']}.")
    return _section("Distances", note, ["recording", "points", "number", "observed", "bias", "mean", "median",
                                        "p95", "p99", "max", "called occupied", "unknown"], rows)


def _free_space(results):
    rows = [[name, str(f["truth_free"]), f"{f['TP']} ({f['TP_share']:.3f})",
             f"{f['TP_high']} ({f['TP_high_share']:.3f})", f"{f['FN']} ({f['FN_share']:.2%})",
             f"{f['FP']} ({f['FP_share']:.2%})", f"{f['FP_high']} ({f['FP_high_share']:.2%})", str(f["unobserved"])]
            for name, f in ((n, r["free_space"]) for n, r in results.items() if "free_space" in r)]
    return _section("Free space", "The 1 m slab around the lidar. TP: free in both; FN: free, called occupied; FP: "
                    "contains surface, called free; shares of the truly free.",
                    ["recording", "truth", "TP", "TP high confidence", "FN", "FP", "FP high confidence",
                     "unknown"], rows)


def markdown(results):
    failed = "".join(f"* {name}: {r['error']}\n" for name, r in results.items() if "error" in r)
    return ("# Results\n\n" + (f"## Failed\n{failed}\n" if failed else "") + _objects(results) + _ghosts(results) +
            _errors(results) + _free_space(results) + _ingest(results))
