#!/usr/bin/env bash
# Measures accuracy and writes results.md, results.json, CSV files and pictures:
#   bash tests/evaluation/run.sh [--data DIR] [--out DIR] [--quick] [--only NAME...] [--parts PART...]
# DIR holds sequence folders; without --data the simulator's own scenes are measured. Parts:
# recordings, robustness, ablations. CLEARANCE_BUILD_DIR as in docker/build.sh. See README.md here.
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
bash "$root/docker/install.sh" runtime build test
build=$(bash "$root/docker/build.sh" bin/clearance_server bin/clearance_sim bin/map_variant \
  bin/local_field_study bin/stage_times lib/libclearance_truth.so clearance_python)
CLEARANCE_TRUTH_LIBRARY="$build/lib/libclearance_truth.so" \
  exec /usr/bin/python3 -B "$root/tests/evaluation/evaluate.py" --build "$build" "$@"
