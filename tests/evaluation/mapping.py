"""One recording in one map of the server."""
import re
import time

import numpy as np

MAX_DISTANCE_M = 5.0


def map_id(name):
    return re.sub(r"[^a-z0-9_-]", "-", name.lower()).lstrip("0123456789_-")[:63] or "map"


class Mapping:
    """Creates the map, streams the recording, answers; deletes the map at the end of the with block."""

    def __init__(self, server, sequence, name=None):
        self._server, self.sequence = server, sequence
        self.name = map_id(name or sequence.name)
        self.acks, self.mesh_ms = [], []

    def __enter__(self):
        s = self.sequence
        self._server.create(self.name, s.voxel_m, s.sensor["max_range_m"], MAX_DISTANCE_M)
        return self

    def __exit__(self, *_):
        self._server.delete(self.name)

    def stream(self, frames=None, after=None):
        """Sends the frames (default: all that arrive), one after the other; after(frame) follows each."""
        for k in self.sequence.frames() if frames is None else frames:
            self.acks.append(self._server.send(self.name, self.sequence, k))
            if after:
                after(k)

    def mesh(self, object_id):
        """An object's mesh in W at the newest frame; RuntimeError where there is none."""
        started = time.perf_counter()
        vertices, faces = self._server.mesh(self.name, object_id)
        self.mesh_ms.append(1e3 * (time.perf_counter() - started))
        return vertices, faces

    def answer(self, **how):
        """The server's query as a function of points; how: horizon_s, static_only, weighted."""
        return lambda points: self._server.query(self.name, points, **how)

    def times(self):
        """Of the frames that were integrated: counts, milliseconds by stage, and of mesh exports."""
        status = [a.status for a in self.acks]
        spent = np.array([a.integrate_ms for a in self.acks if a.status == "integrated"])
        stages, memory = self._server.stages(self.name)
        violations = [v for a in self.acks for v in a.violations]
        result = {"integrated": status.count("integrated"), "rejected": status.count("rejected"),
                  "dropped": status.count("dropped"), "violations": len(violations),
                  "first_violations": violations[:3], "memory_mb": memory / 1e6, "stages": stages}
        for name, values in (("frame", spent), ("mesh", np.array(self.mesh_ms))):
            if len(values):
                result[name] = {"count": len(values), "p50_ms": float(np.median(values)),
                                "p95_ms": float(np.percentile(values, 95))}
        return result
