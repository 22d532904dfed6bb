#!/usr/bin/env bash
# Configures and builds a Release with Ninja: docker/build.sh [TARGET...] (default: everything).
# Prints its progress on stderr and the build folder as the only line on stdout.
#
#   CLEARANCE_BUILD_DIR   build folder (default: build, with -address or -thread for a sanitizer)
#   CLEARANCE_SANITIZE    empty, address or thread
#   CLEARANCE_JOBS        parallel jobs (default: as many as there are cores)
#   CLEARANCE_CMAKE_ARGS  further arguments for cmake, separated by blanks
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
sanitize=${CLEARANCE_SANITIZE-}
build=${CLEARANCE_BUILD_DIR:-$root/build${sanitize:+-$sanitize}}
mkdir -p "$build"
build=$(cd "$build" && pwd)
read -r -a more <<<"${CLEARANCE_CMAKE_ARGS-}" || true

# Several checkouts share what ccache keeps.
export CCACHE_BASEDIR="$root" CCACHE_NOHASHDIR=1

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release \
  -DCLEARANCE_SANITIZE="$sanitize" ${more[@]+"${more[@]}"} >&2
cmake --build "$build" --parallel "${CLEARANCE_JOBS:-$(nproc)}" ${1:+--target "$@"} >&2
echo "$build"
