#!/usr/bin/env bash
# The main job on an embedded default: installs, builds, starts a server, streams a simulated
# crossing into it, asks, and leaves pictures and a short table:
#   bash planner_demo/run.sh [OUT]        (default: out, in the top folder of the tree)
# CLEARANCE_DEMO_SEED picks another crossing; CLEARANCE_BUILD_DIR as in docker/build.sh.
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
mkdir -p "${1:-$root/out}"
out=$(cd "${1:-$root/out}" && pwd)
seed=${CLEARANCE_DEMO_SEED:-7}
frames=60
last_s=5.9  # the stamp of the last frame
python=/usr/bin/python3

bash "$root/docker/install.sh" runtime build test
build=$(bash "$root/docker/build.sh" bin/clearance_server bin/clearance bin/clearance_sim)

scratch=$(mktemp -d)
server_pid=
stop() {
  if [ -n "$server_pid" ] && kill -TERM "$server_pid" 2>/dev/null; then
    wait "$server_pid" || true
  fi
  rm -rf "$scratch"
}
trap stop EXIT
trap 'exit 130' INT TERM

echo "Starting the server"
"$build/bin/clearance_server" --config "$root/server/config/default.yaml" --listen 127.0.0.1:0 \
  --socket "$scratch/clearance.sock" --http off >"$out/server.log" 2>&1 &
server_pid=$!
for _ in $(seq 200); do
  if grep -q '^ready' "$out/server.log"; then break; fi
  if ! kill -0 "$server_pid" 2>/dev/null; then
    echo "$0: the server did not start:" >&2
    cat "$out/server.log" >&2
    exit 1
  fi
  sleep 0.1
done
export CLEARANCE_SERVER="unix:$scratch/clearance.sock"
ask() { "$build/bin/clearance" --map crossing "$@"; }
simulate() { "$build/bin/clearance_sim" --scene crossing --seed "$seed" --frames "$frames" "$@"; }

echo "Simulating a crossing: $frames frames of a lidar at the kerb, ten vehicles, two pedestrians"
simulate --out "$scratch/crossing" --quiet
echo "Streaming it"
ask ingest "$scratch/crossing" --rate max

echo "Asking"
{
  echo "The map"
  ask info
  echo
  echo "Moving objects"
  ask objects
  echo
  echo "Clearance in the middle of the crossing, now and a second ahead"
  ask query 0 0 0.5
  ask query 0 0 0.5 --horizon 1
  echo
} >"$out/table.txt"

awk 'BEGIN { print "x,y,z"; for (x = -20; x <= 20; ++x) for (y = -20; y <= 20; ++y)
  printf "%d.1,%d.1,0.5\n", x, y }' >"$scratch/points.csv"
for ahead_s in 0 0.5 1 2; do
  ask slice --z 0.5 --horizon "$ahead_s" --bounds -32 -32 32 32 --out "$out/slice_$ahead_s.png" \
    >/dev/null
  ask query --points "$scratch/points.csv" --horizon "$ahead_s" \
    --out "$scratch/answers_$ahead_s.csv" >/dev/null
  at=$(awk -v a="$last_s" -v b="$ahead_s" 'BEGIN { print a + b }')
  simulate --distances-of "$scratch/points.csv" --at "$at" --out "$scratch/truth_$ahead_s.csv"
done
"$python" -B "$root/planner_demo/demo_table.py" "$scratch" >>"$out/table.txt"

ask mesh --out "$out/map.ply" >/dev/null
# The object with the most observations shows best.
object=$(ask --json objects | "$python" -c '
import json, sys
objects = json.load(sys.stdin)["objects"]
print(max(objects, key=lambda o: o["observations"])["object_id"] if objects else "")')
if [ -n "$object" ]; then
  ask mesh --object "$object" --out "$out/object_$object.ply" >/dev/null
fi
MPLCONFIGDIR="$scratch" "$python" -B "$root/planner_demo/demo_pictures.py" "$out"

echo
cat "$out/table.txt"
echo
echo "Pictures and table are in $out: overview.png, slice_*.png, meshes.png, table.txt, *.ply"
