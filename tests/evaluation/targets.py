"""What the measures ought to reach, judged from the results alone."""
import re

LEAST_FRAMES = 10  # objects seen in fewer frames are not judged
ANALYTIC = ("plane", "box", "sphere", "corner", "pole")
KINDS = ("street", "orbit", "cubes", "hall", "crossing", "parking", *ANALYTIC)


def kind(name):
    """The scene type that a recording's name begins with, or None."""
    match = re.match("|".join(KINDS), name.lower())
    return match.group() if match else None


class Judged:
    """One value beside its target."""

    def __init__(self, what, where, value, target, shown=None, others="", note=""):
        """target: ('<=' | '>=' | '<', number); shown: formats numbers; others: the paper's or peers' figures."""
        self.what, self.where, self.value, self.others, self.note = what, where, value, others, note
        self._sign, self._limit = target
        self.shown = shown or "{:.3f}".format

    @property
    def met(self):
        if self.value is None:
            return False
        return {"<=": self.value <= self._limit, ">=": self.value >= self._limit,
                "<": self.value < self._limit}[self._sign]

    def row(self):
        value = "none" if self.value is None else self.shown(self.value)
        return [self.what, self.where, value, f"{self._sign} {self.shown(self._limit)}",
                "met" if self.met else "missed", self.others, self.note]


def _percent(digits):
    return lambda v: f"{100 * v:.{digits}f} %"


def _metres(v):
    return f"{v:.3f} m"


def _voxels(v):
    return f"{v:.2f} voxel"


def _meshes(name, r):
    for o in r.get("objects", []):
        where = f"{name}, object {o['object']}"
        visible = f"{o.get('visible_share', 0):.1%} of it was ever in view" if "visible_share" in o else o.get("error", "")
        if o["frames_in_view"] < LEAST_FRAMES:
            continue
        if kind(name) == "orbit":
            yield Judged("r_cov, visible surface", where, o.get("r_cov_visible"), (">=", .99), None, "0.961")
            yield Judged("r_cov, all", where, o.get("r_cov"), (">=", .95), None, "0.961", visible)
        if kind(name) == "street":
            yield Judged("RMSE", where, o.get("rmse_m"), ("<=", .05), _metres, "0.12 to 0.17 m")
            yield Judged("visible surface covered", where, o.get("r_cov_surface_visible"), (">=", .95), None, "",
                         visible)
        if kind(name) == "cubes":
            yield Judged("RMSE", where, o.get("rmse_m"), ("<=", .025), _metres, "pictures only")


def _space(name, r):
    if "free_space" in r and kind(name) == "hall":
        f = r["free_space"]
        yield Judged("free space, TP of truth", name, f["TP_share"], (">=", .98), _percent(2), "0.92 at best")
        yield Judged("free space, FN of truth", name, f["FN_share"], ("<=", .001), _percent(3), "0.03 % at best")
        yield Judged("free space, FP of truth", name, f["FP_share"], ("<=", .005), _percent(2), "0.5 % at best")
    for what, row in r.get("truly_occupied", {}).items():
        if what != "static":
            continue
        for confidence, limit, digits in (("high", 1e-4, 4), ("low", .007, 3)):
            yield Judged(f"truly occupied called free, {confidence} confidence", name,
                         row[f"free_{confidence}_share"], ("<", limit), _percent(digits), "",
                         f"{row[f'free_{confidence}_share_of_known']:.{digits - 2}%} of those with a known state")
    for labels, g in r.get("ghosts", {}).items():
        if labels in ("as recorded", "parked without labels"):
            yield Judged("ghost voxels" if labels == "as recorded" else f"ghost voxels, {labels}", name,
                         g["ghosts"], ("<=", 0), str, "", f"of {g['seen_again']} seen again")


def _field(name, r):
    static = r.get("static", {})
    if static.get("points") and not r.get("depth_noise_m"):
        if kind(name) == "street":
            yield Judged("distance error, static, mean", name, static["mean"], ("<=", .15), _voxels,
                         "voxblox 0.54, nvblox-like 0.34")
            yield Judged("distance error, static, p95", name, static["p95"], ("<=", .4), _voxels,
                         "OctoMap 0.95, the best of six")
        if kind(name) in ANALYTIC:
            yield Judged("distance error, static, p99", name, static["p99"], ("<=", .5), _voxels, "nvblox-like 1")
    near = r.get("near_objects", {})
    for h, truth, limit in (("0", "true motion", .5), ("1", "constant twist", 1.0)):
        row = near.get(h, {}).get(truth, {}).get("all", {})
        if row.get("points"):
            when = "now" if h == "0" else f"{h} s ahead at constant twist"
            yield Judged(f"distance error within 2 m of objects, {when}, mean", name, row["mean"], ("<=", limit),
                         _voxels, "")


def judge(results):
    """Everything that has a target, in the order of the recordings."""
    found = []
    for part in (_meshes, _field, _space):
        for name, r in results["recordings"].items():
            found += part(name, r)
    return found
