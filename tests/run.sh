#!/usr/bin/env bash
# Installs what docker/packages.txt lists, builds a Release and runs every test:
#   bash tests/run.sh [ARGUMENTS FOR CTEST...]      for example: -R QueryPoints
#   bash tests/run.sh --long                        instead: what takes long, with a table (tests/long.sh)
# CLEARANCE_BUILD_DIR, CLEARANCE_SANITIZE=address|thread and CLEARANCE_JOBS as in docker/build.sh.
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

bash "$root/docker/install.sh" runtime build test
build=$(bash "$root/docker/build.sh")
[ "${1-}" = --long ] && exec bash "$root/tests/long.sh" "$build"
exec ctest --test-dir "$build" --output-on-failure --parallel "${CLEARANCE_JOBS:-$(nproc)}" "$@"
