#!/usr/bin/env bash
# Everything that takes long, one line of a table each: tests/long.sh BUILD_FOLDER. Called by
# tests/run.sh --long. CLEARANCE_SOAK_MINUTES (30) and CLEARANCE_DATA_DIR as for the tests.
set -uo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=$1
server=$build/bin/clearance_server command=$build/bin/clearance
data=${CLEARANCE_DATA_DIR:-$root/../shared/data}
export PYTHONPATH=$build/python
logs=$build/long
mkdir -p "$logs"
rows=() failed=0

# long NAME COMMAND...: runs it with its output in a file; the last line is the row's text.
long() {
  local name=$1 log=$logs/${1// /_}.log
  shift
  echo "== $name: $*"
  if "$@" > >(tee "$log") 2>&1; then verdict=ok; else verdict=FAILED failed=1; fi
  rows+=("$(printf '%-28s %-6s %s' "$name" "$verdict" "$(tail -n 1 "$log")")")
}

long "kills interval" "$build/bin/kill_program" "$server" --rounds 50 --seed 1
long "kills each" "$build/bin/kill_program" "$server" --rounds 50 --seed 2 --sync each
long "kills off" "$build/bin/kill_program" "$server" --rounds 50 --seed 3 --sync off
long "soak" /usr/bin/python3 "$root/tests/store/soak.py" "$server" "$command" \
  --minutes "${CLEARANCE_SOAK_MINUTES:-30}"
if [ -d "$data/kitti_0005" ]; then
  for only in overhead replay snapshot; do
    long "kitti_0005 $only" /usr/bin/python3 "$root/tests/store/measure.py" "$server" "$command" \
      "$data/kitti_0005" --only $only
  done
  long "street replay" /usr/bin/python3 "$root/tests/store/measure.py" "$server" "$command" \
    "$data/street" --only replay --voxel 0.1
  long "TLS" /usr/bin/python3 "$root/tests/service/load.py" "$server" "$command" \
    "$data/kitti_0005" --only tls
  long "street big snapshot" /usr/bin/python3 "$root/tests/store/measure.py" "$server" \
    "$command" "$data/street" --only snapshot --voxel 0.1 --big
fi

echo
printf '%s\n' "${rows[@]}"
exit $failed
