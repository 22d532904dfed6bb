#!/usr/bin/env bash
# Measures accuracy and writes results.md and results.json:
#   bash tests/evaluation/run.sh [--data DIR] [--out DIR] [--quick] [--only NAME...]
# DIR holds sequence folders; without --data the simulator's own scenes are measured.
# CLEARANCE_BUILD_DIR as in docker/build.sh.
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
bash "$root/docker/install.sh" runtime build test
build=$(bash "$root/docker/build.sh" bin/clearance_server bin/clearance bin/clearance_sim \
  lib/libclearance_truth.so)
CLEARANCE_TRUTH_LIBRARY="$build/lib/libclearance_truth.so" \
  exec /usr/bin/python3 -B "$root/tests/evaluation/evaluate.py" --build "$build" "$@"
