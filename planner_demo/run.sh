#!/usr/bin/env bash
# Installs, builds, starts a server and drives a robot through moving traffic on the map it keeps,
# four ways over the same seeds: with the map and its predictions, on a frozen snapshot, with all
# objects fused into the static map, and straight ahead:
#   bash planner_demo/run.sh [OUT]        (default: out, in the top folder of the tree)
# Leaves drive.gif, contact_sheet.png and table.txt. CLEARANCE_DEMO_SCENE (crossing, street, drone),
# CLEARANCE_DEMO_SEED and CLEARANCE_DEMO_EPISODES pick others; CLEARANCE_BUILD_DIR as in
# docker/build.sh.
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
mkdir -p "${1:-$root/out}"
out=$(cd "${1:-$root/out}" && pwd)
scene=${CLEARANCE_DEMO_SCENE:-crossing}
seed=${CLEARANCE_DEMO_SEED:-7}
episodes=${CLEARANCE_DEMO_EPISODES:-3}
python=/usr/bin/python3

bash "$root/docker/install.sh" runtime build test
build=$(bash "$root/docker/build.sh" bin/clearance_server bin/clearance_planner_demo)

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

echo "Driving: $scene, $episodes seeds from $seed on, four ways each"
"$build/bin/clearance_planner_demo" --scene "$scene" --seed "$seed" --episodes "$episodes" \
  --out "$out" >"$out/table.txt"
MPLCONFIGDIR="$scratch" "$python" -B "$root/planner_demo/drive_pictures.py" "$out"

echo
cat "$out/table.txt"
echo
echo "Pictures and table are in $out: drive.gif, contact_sheet.png, table.txt"
