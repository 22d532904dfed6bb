"""The same measures on what a real front end would have delivered."""
from degrade import Degraded
from mapping import Mapping

FRAMES = 100  # of longer recordings: drift is stated over so many

VARIANTS = {
    "as recorded": {},
    "depth noise 1 cm": {"depth_sigma_m": .01},
    "depth noise 2 cm": {"depth_sigma_m": .02},
    "depth noise 5 cm": {"depth_sigma_m": .05},
    "labels 3 px too small": {"shrink_px": 3},
    "labels 3 px too large": {"grow_px": 3},
    "labels 10 frames late": {"late_frames": 10},
    "motion noise 5 mm a frame": {"motion_sigma_m": .005},
    "motion noise 1 cm a frame": {"motion_sigma_m": .01},
    "motion noise 2 cm a frame": {"motion_sigma_m": .02},
    "every 5th frame lost, with its motions": {"lost_every": 5},
    "every 5th frame lost, motions bridged": {"lost_every": 5, "bridged_motions": True},
}
QUICK = ("as recorded", "depth noise 2 cm", "labels 3 px too small")
OF_OBJECTS = ("shrink_px", "grow_px", "late_frames", "motion_sigma_m", "lost_every")
RAW_POSES = "trajectory_oxts_raw.tum"


class Shortened:
    """The first frames of a sequence; everything else as it is."""

    def __init__(self, sequence, frame_count):
        self.base, self.frame_count = sequence, min(frame_count, sequence.frame_count)

    def __getattr__(self, name):
        if name == "base":
            raise AttributeError(name)
        return getattr(self.base, name)

    def frames(self):
        return list(range(self.frame_count))


def variants(sequence, quick=False):
    """{title: options of Degraded} that mean something for the recording."""
    found = {}
    for title, how in VARIANTS.items():
        if quick and title not in QUICK:
            continue
        if sequence.motions or not any(name in how for name in OF_OBJECTS):
            found[title] = how
    if (sequence.folder / RAW_POSES).exists():
        found["raw GPS and inertial poses"] = {"trajectory": RAW_POSES}
    return found


def measure(server, measures, how, name):
    """One variant of the recording behind `measures`: {measure: result}."""
    degraded = Degraded(measures.sequence, **how)
    with Mapping(server, degraded, name) as mapping:
        mapping.stream()
        result = {"times": mapping.times(), "returns": measures.returns(mapping)}
        world = measures.world
        if world:
            result["static"] = measures.static_distances(mapping)
            result["truly_occupied"] = measures.truly_occupied(mapping)
        if world and world.objects:
            result["objects"] = measures.meshes(mapping)
            result["near_objects"] = measures.near_objects(mapping, (0.0, 1.0))
        # With other sensor poses the map lies elsewhere than the truth.
        if measures.has_swept_space and "trajectory" not in how:
            result["ghosts"] = measures.ghosts(mapping)
        return result
