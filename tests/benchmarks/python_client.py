"""Latency of the Python client: 10,000 random points with gradients. Prints JSON."""
import json
import sys
import time

import numpy as np
from clearance import Client

with Client(sys.argv[1], map=sys.argv[2]) as client:
    rng = np.random.default_rng(1)
    points = rng.uniform([0, -8, 0], [20, 8, 3], (10000, 3))
    times_ms = []
    for _ in range(40):
        start = time.perf_counter()
        client.query(points, objects=False, sigmas=False)
        times_ms.append((time.perf_counter() - start) * 1e3)
    print(json.dumps({"p50_ms": float(np.median(times_ms)),
                      "p99_ms": float(np.percentile(times_ms, 99))}))
