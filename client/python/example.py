"""How far is the nearest surface, now and in a second? Needs a server: clearance_server."""
import sys
from clearance import Client

with Client(*sys.argv[1:]) as client:
    answers = client.query([[10.0, 2.0, 0.5], [5.0, 0.0, 0.5]])
    ahead = client.distances([[10.0, 2.0, 0.5], [5.0, 0.0, 0.5]], horizon_s=1.0)
    for d, state, gradient, later in zip(*answers[:3], ahead):
        print(f"{d:.2f} m, state {state & 3}, away along {gradient}, in a second {later:.2f} m")
