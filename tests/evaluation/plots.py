"""Pictures of the results."""
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: E402

COLOURS = plt.get_cmap("tab10").colors
PAPER_COVERAGE = 0.961


def _save(figure, out, name):
    figure.tight_layout()
    figure.savefig(out / f"{name}.png", dpi=110)
    plt.close(figure)


def coverage(results, out):
    """Coverage and RMSE by frame, a picture for each recording."""
    for name, r in results["recordings"].items():
        rows = [row for row in r.get("coverage", []) if row.get("rmse_m") is not None]
        if not rows:
            continue
        figure, (above, below) = plt.subplots(2, 1, figsize=(8, 7), sharex=True)
        for i, j in enumerate(sorted({row["object"] for row in rows})):
            mine, colour = [row for row in rows if row["object"] == j], COLOURS[i % 10]
            frames = [row["frame"] for row in mine]
            above.plot(frames, [row["r_cov_visible"] for row in mine], color=colour, label=f"object {j}")
            above.plot(frames, [row["r_cov"] for row in mine], color=colour, linestyle=":")
            below.plot(frames, [100 * row["rmse_m"] for row in mine], color=colour)
        if name.startswith("orbit"):
            above.axhline(PAPER_COVERAGE, color="grey", linewidth=.8)
            above.text(0, PAPER_COVERAGE, " the paper, all", fontsize=8, va="bottom", color="grey")
        above.set(ylim=(0, 1.02), ylabel="r_cov", title=f"{name}: coverage, visible surface (solid) and all (dotted)")
        above.legend(fontsize=8, ncol=3)
        below.set(ylim=(0, None), ylabel="RMSE of the vertices, cm", xlabel="frame")
        for axes in (above, below):
            axes.grid(alpha=.3)
        _save(figure, out, f"coverage_{name}")


def horizons(results, out):
    """Mean error near objects by horizon, for the true future and at constant twist."""
    recordings = {n: r["near_objects"] for n, r in results["recordings"].items() if r.get("near_objects")}
    if not recordings:
        return
    figure, axes = plt.subplots(figsize=(8, 4.5))
    for i, (name, near) in enumerate(sorted(recordings.items())):
        for truth, style in (("constant twist", "-o"), ("true motion", ":s")):
            points = [(float(h), regions[key]["all"]["mean"]) for h, regions in near.items()
                      for key in [truth if truth in regions else "true motion"]
                      if (key in regions) and (h == "0" or key == truth) and regions[key]["all"].get("points")]
            if points:
                axes.plot(*zip(*points), style, color=COLOURS[i % 10],
                          label=name if truth == "constant twist" else None)
    axes.axhline(1, color="grey", linewidth=.8)
    axes.set(xlabel="seconds ahead", ylabel="mean |error|, voxels", ylim=(0, None),
             title="Distances within 2 m of objects: at constant twist (solid), true future (dotted)")
    axes.grid(alpha=.3)
    axes.legend(fontsize=8)
    _save(figure, out, "horizons")


def direct_estimate(results, out):
    rows = results.get("local_fields", {}).get("frustum", [])
    if not rows:
        return
    figure, axes = plt.subplots(figsize=(8, 4.5))
    for i, length in enumerate(sorted({r["length_voxels"] for r in rows})):
        mine = [r for r in rows if r["length_voxels"] == length and r["direct"].get("points")]
        axes.plot([(r["from_m"] + r["to_m"]) / 2 for r in mine], [r["direct"]["mean"] for r in mine], "-o",
                  color=COLOURS[i], label=f"field around the nearest point, length scale {length:g} voxels")
        axes.plot([(r["from_m"] + r["to_m"]) / 2 for r in mine], [r["leaf"]["mean"] for r in mine], ":^",
                  color=COLOURS[i], label=f"field of the nearest leaf, length scale {length:g} voxels")
    first = [r for r in rows if r["length_voxels"] == rows[0]["length_voxels"]]
    axes.plot([(r["from_m"] + r["to_m"]) / 2 for r in first], [r["closest_site"]["mean"] for r in first], "-s",
              color="black", label="closest site")
    axes.set(xlabel="true distance, m", ylabel="mean |error|, voxels", yscale="log",
             title="Local Gaussian processes throughout the view (where they answer)")
    axes.grid(alpha=.3, which="both")
    axes.legend(fontsize=8)
    _save(figure, out, "direct_estimate")


def robustness(results, out):
    """What each variant does to static distances and to meshes."""
    for name, variants in results.get("robustness", {}).items():
        rows = [(title, r) for title, r in variants.items() if r.get("static", {}).get("points")]
        if not rows:
            continue
        figure, axes = plt.subplots(1, 2, figsize=(11, .4 * len(rows) + 1.8), sharey=True)
        titles = [title for title, _ in rows]
        axes[0].barh(titles, [r["static"]["mean"] for _, r in rows], color=COLOURS[0])
        axes[0].set(xlabel="static distance, mean |error|, voxels")
        rmse = [[o["rmse_m"] for o in r.get("objects", []) if o["frames_in_view"] >= 10 and
                 o.get("rmse_m") is not None] for _, r in rows]
        axes[1].barh(titles, [100 * sum(e) / len(e) if e else 0 for e in rmse], color=COLOURS[1])
        axes[1].set(xlabel="meshes, mean RMSE, cm")
        axes[0].invert_yaxis()
        for a in axes:
            a.grid(alpha=.3, axis="x")
        figure.suptitle(name)
        _save(figure, out, f"robustness_{name}")


def phases(name, shots, out):
    """Every object at several frames: the map's mesh, coloured by its error, in the lines of the true shape.

    shots: [(frame, [(object id, true vertices, true faces, vertices, faces, error m)])] in W.
    """
    rows = len(shots[0][1])
    figure = plt.figure(figsize=(3.4 * len(shots), 3.1 * rows + .6))
    highest = max([e.max() for _, objects in shots for *_, e in objects if len(e)] + [1e-6])
    for column, (frame, objects) in enumerate(shots):
        for row, (j, true_vertices, true_faces, vertices, faces, error) in enumerate(objects):
            axes = figure.add_subplot(rows, len(shots), row * len(shots) + column + 1, projection="3d")
            axes.add_collection3d(Poly3DCollection(true_vertices[true_faces], facecolor=(0, 0, 0, 0),
                                                   edgecolor="grey", linewidth=.4))
            if len(faces):
                colours = plt.get_cmap("viridis")(error[faces].mean(1) / highest)
                axes.add_collection3d(Poly3DCollection(vertices[faces], facecolor=colours, edgecolor="none"))
            middle = (true_vertices.min(0) + true_vertices.max(0)) / 2
            half = 1.1 * (true_vertices.max(0) - true_vertices.min(0)).max() / 2
            axes.set(**{f"{a}lim": (m - half, m + half) for a, m in zip("xyz", middle)},
                     title=f"object {j}, frame {frame}")
            axes.set_box_aspect((1, 1, 1))
            axes.tick_params(labelsize=5)
    figure.suptitle(f"{name}: error of the vertices, 0 (dark) to {100 * highest:.1f} cm (bright)")
    _save(figure, out, f"phases_{name}")


def all_pictures(results, out):
    for draw in (coverage, horizons, direct_estimate, robustness):
        draw(results, out)
