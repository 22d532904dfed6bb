"""What the method's choices are worth: the same measures with other choices."""
import json
import pathlib
import subprocess
import tempfile

import cv2
import numpy as np

import field_error
import object_mesh
import ply
import poses
from degrade import Degraded
from robustness import Shortened

FRAMES = 30
QUICK_FRAMES = 8

VARIANTS = {
    "defaults": [],
    "length scale 0.5 voxel": ["--length", "0.5"],
    "length scale 1.5 voxels": ["--length", "1.5"],
    "length scale 2 voxels": ["--length", "2"],
    "Matern 3/2 kernel": ["--kernel", "matern"],
    "rational quadratic kernel, 1 voxel": ["--kernel", "rq"],
    "rational quadratic kernel, 3 voxels": ["--kernel", "rq", "--length", "3"],
    "weight cap 3": ["--max-weight", "3"],
    "weight cap 100": ["--max-weight", "100"],
    "constant weights": ["--constant-weights"],
}
QUICK = ("defaults", "length scale 2 voxels", "constant weights")


def _run(command):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode != 0:
        raise RuntimeError(f"{pathlib.Path(command[0]).name}: exit {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def _noisy_copy(sequence, sigma_m, frames, folder):
    """The first frames with depth noise, as a folder that map_variant reads."""
    noisy = Degraded(sequence, depth_sigma_m=sigma_m)
    folder.mkdir()
    for path in sequence.folder.resolve().iterdir():
        if path.name not in ("depth", "cloud"):
            (folder / path.name).symlink_to(path)
    kind = "depth" if sequence.is_camera else "cloud"
    (folder / kind).mkdir()
    for k in range(frames):
        path = folder / kind / sequence.scan_path(kind, k).name
        if sequence.is_camera:
            cv2.imwrite(str(path), noisy.images(k)[0], [cv2.IMWRITE_PNG_COMPRESSION, 1])
        else:
            ply.write_cloud(path, *noisy.scan(k))
    return folder


def variants(build, sequence, world, effort, quick, noise_m=0.0):
    """Rows of every variant on the first frames of a recording: {title: measures}."""
    frames = min(QUICK_FRAMES if quick else FRAMES, sequence.frame_count)
    short = Shortened(sequence, frames)
    points = field_error.points_in_the_open(short, effort.points)
    true, nearest, owner = world.distance(points, objects=[])
    observed = field_error.ObservedSurface(world.of(short), effort.scans)
    keep = (true > 0) & (true < 5.0)
    keep[keep] = observed.contains(nearest[keep], owner[keep], {})
    points, true = points[keep], true[keep]
    seen = sorted({int(j) for k in range(frames) for j in np.unique(sequence.scan(k)[1])} & set(world.objects))
    surfaces = {}
    for j in seen:
        samples = world.objects[j].sample(effort.samples)
        surfaces[j] = samples, world.visible(j, samples, range(frames))
    rows = {}
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        folder = sequence.folder if not noise_m else _noisy_copy(sequence, noise_m, frames, scratch / "noisy")
        points.astype("<f8").tofile(scratch / "points.f64")
        for title, options in VARIANTS.items():
            if quick and title not in QUICK:
                continue
            out = scratch / "out"
            ms = float(_run([f"{build}/bin/map_variant", folder, "--out", out, "--frames", frames, "--points",
                             scratch / "points.f64", *options]))
            answers = np.fromfile(out / "answers.f64", "<f8").reshape(-1, 3)
            row = {"integrate_ms": ms, "field": field_error.statistics(answers[:, 0] - true, sequence.voxel_m)}
            if title == "defaults":
                row["sub-voxel sites"] = field_error.statistics(answers[:, 1] - true, sequence.voxel_m)
                row["voxel centres as sites"] = field_error.statistics(answers[:, 2] - true, sequence.voxel_m)
            row["objects"] = [_compare(world, j, frames - 1, out / f"object_{j}.ply", *surfaces[j])
                              for j in seen if (out / f"object_{j}.ply").exists()]
            rows[title] = row
            for path in out.glob("*"):
                path.unlink()
    return {"frames": frames, "noise_m": noise_m, "variants": rows}


def _compare(world, j, frame, path, samples, visible):
    vertices, faces = ply.read_mesh(path)
    vertices = poses.apply(poses.inverse(world.pose(j, frame)), vertices)
    return {"object": j, **object_mesh.compare(world.objects[j], vertices, faces, samples, visible,
                                               world.sequence.voxel_m)}


def local_fields(build, quick):
    """Kernels, neighbourhoods and the direct estimate throughout the view, on analytic scenes."""
    return json.loads(_run([f"{build}/bin/local_field_study", "--seeds", 1 if quick else 3]))


def stage_times(build, sequence, quick):
    """{stage: {'count', 'p50_ms', 'p95_ms'}} of a recording, in process."""
    command = [f"{build}/bin/stage_times", sequence.folder]
    times = json.loads(_run(command + (["--frames", 20] if quick else [])))
    return {stage: {"count": len(ms), "p50_ms": float(np.median(ms)), "p95_ms": float(np.percentile(ms, 95))}
            for stage, ms in times.items() if ms}
