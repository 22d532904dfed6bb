#!/usr/bin/env bash
# Measures speed and memory, beside the peers that Debian packages:
#   bash tests/benchmarks/run.sh [--quick] [--json FILE]
# --quick ends within 50 s once everything is built. Recordings are read from CLEARANCE_DATA_DIR
# (default ../shared/data beside the source tree); what is missing there is simulated.
# CLEARANCE_BUILD_DIR and CLEARANCE_JOBS as in docker/build.sh.
set -euo pipefail
exec </dev/null
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
python=/usr/bin/python3

quick=0
json=
while [ $# -gt 0 ]; do
  case $1 in
    --quick) quick=1 ;;
    --json) json=${2:?--json needs a FILE}; shift ;;
    *) echo "usage: $0 [--quick] [--json FILE]" >&2; exit 2 ;;
  esac
  shift
done
if [ -n "$json" ]; then json=$(realpath -m "$json"); fi

bash "$root/docker/install.sh" runtime build test bench
build=$(CLEARANCE_CMAKE_ARGS="${CLEARANCE_CMAKE_ARGS-} -DCLEARANCE_BENCHMARKS=ON" bash "$root/docker/build.sh" \
  bin/clearance_server bin/clearance_sim bin/query_benchmark bin/integration_benchmark \
  bin/rpc_benchmark bin/peers_benchmark clearance_python)

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

frames=20
sequences=street,orbit,kitti_0005,hall
if [ $quick = 1 ]; then
  frames=10
  sequences=street,kitti_0005
fi

# --- input ---------------------------------------------------------------------------------------
data=${CLEARANCE_DATA_DIR:-$root/../shared/data}
for name in ${sequences//,/ }; do
  if [ -e "$data/$name/sequence.json" ]; then
    ln -s "$(cd "$data/$name" && pwd)" "$scratch/$name"
    continue
  fi
  # A drive with a spinning lidar among vehicles stands in for the recorded one.
  scene=${name/kitti_0005/crossing}
  kept="$build/benchmark-data/$scene-$frames"
  if [ ! -e "$kept/sequence.json" ]; then
    echo "No $data/$name: simulating $frames frames of $scene"
    mkdir -p "$build/benchmark-data"
    rm -rf "$kept.part"
    "$build/bin/clearance_sim" --scene "$scene" --seed 1 --frames "$frames" --quiet --out "$kept.part"
    mv "$kept.part" "$kept"
  fi
  ln -s "$kept" "$scratch/$name"
done

# --- measure -------------------------------------------------------------------------------------
measure() {  # NAME ARGUMENTS...
  local name=$1
  shift
  echo "Measuring: $name" >&2
  "$build/bin/$name" "$@" --benchmark_out="$scratch/$name.json" --benchmark_out_format=json \
    --benchmark_min_time="$min_time" >"$scratch/$name.txt" || {
    cat "$scratch/$name.txt" >&2
    echo "$0: $name failed" >&2
    exit 1
  }
}

min_time=0.5
filter=.
repeats=100
peer_frames=4
if [ $quick = 1 ]; then
  min_time=0.05
  filter='^(Random/2/|Coherent/2/0|Random/5/0|Coherent/5/0)'
  repeats=10
  peer_frames=2
fi
measure query_benchmark --benchmark_filter="$filter"
measure integration_benchmark --data="$scratch" --sequences="$sequences" --frames="$frames" \
  --repeats="$repeats"

"$build/bin/clearance_server" --config "$root/server/config/default.yaml" --listen 127.0.0.1:0 \
  --socket "$scratch/clearance.sock" --http off >"$scratch/server.log" 2>&1 &
server_pid=$!
for _ in $(seq 300); do
  if grep -q '^ready' "$scratch/server.log"; then break; fi
  if ! kill -0 "$server_pid" 2>/dev/null; then
    cat "$scratch/server.log" >&2
    exit 1
  fi
  sleep 0.1
done
tcp=$(sed -n 's/^gRPC on \(127[^ ]*\).*/\1/p' "$scratch/server.log" | head -n 1)
measure rpc_benchmark --tcp="$tcp" --socket="$scratch/clearance.sock" --pid="$server_pid" \
  --data="$scratch" --frames="$frames" --quick=$quick
PYTHONDONTWRITEBYTECODE=1 PYTHONPATH="$build/python" "$python" "$here/python_client.py" \
  "$scratch/clearance.sock" street >"$scratch/python_client.json"
kill -TERM "$server_pid"
wait "$server_pid" || true
server_pid=
measure peers_benchmark --data="$scratch" --frames="$peer_frames"

"$python" -B "$here/report.py" "$scratch" ${json:+--json "$json"}
