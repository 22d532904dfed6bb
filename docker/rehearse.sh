#!/usr/bin/env bash
# The Dockerfile's two stages in Debian roots made for the purpose, ending with a healthy server that
# runs from the runtime stage's packages alone. Needs root and debootstrap; takes a network as apt has
# it, and about 4 GB.
#   docker/rehearse.sh [--built BUILD] [FOLDER]   (default: a temporary folder, removed at the end)
# --built: the runtime stage alone, with what a build folder on Debian 12 has installed from.
set -euo pipefail
exec </dev/null
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
built=
if [ "${1-}" = --built ]; then
  built=$(cd "$2" && pwd)
  shift 2
fi
if [ "$(id -u)" -ne 0 ] || ! command -v debootstrap >/dev/null; then
  echo "$0: needs root and debootstrap (apt-get install debootstrap)" >&2
  exit 2
fi
work=${1:-$(mktemp -d)}
mkdir -p "$work"
cleanup() {
  for stage in build runtime; do
    umount "$work/$stage/proc" 2>/dev/null || true
  done
  [ $# -gt 0 ] || rm -rf "$work"
}
trap 'cleanup "$@"' EXIT

# The mirror and the trust that this machine's own apt uses.
mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 2>/dev/null | head -n 1)

new_stage() {  # name
  echo "== a Debian root for the stage $1"
  debootstrap --variant=minbase bookworm "$work/$1" ${mirror:+"$mirror"} >"$work/$1.log" 2>&1 || {
    tail -n 20 "$work/$1.log" >&2
    exit 1
  }
  rm -rf "$work/$1/etc/apt/sources.list" "$work/$1/etc/apt/sources.list.d" "$work/$1/etc/apt/apt.conf.d"
  cp -rL /etc/apt/sources.list* /etc/apt/apt.conf.d "$work/$1/etc/apt/" 2>/dev/null || true
  cp -L /etc/resolv.conf /etc/hosts "$work/$1/etc/" 2>/dev/null || true
  mount -t proc proc "$work/$1/proc"
  mkdir -p "$work/$1/tmp/docker"
  cp "$root/docker/packages.txt" "$root/docker/install.sh" "$work/$1/tmp/docker/"
}
inside() {  # stage command...
  local stage=$1
  shift
  env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
    ${http_proxy:+http_proxy="$http_proxy"} ${https_proxy:+https_proxy="$https_proxy"} \
    chroot "$work/$stage" "$@"
}

build_stage() {
  new_stage build
  inside build bash /tmp/docker/install.sh runtime build
  mkdir -p "$work/build/source"
  git -C "$root" archive HEAD | tar -x -C "$work/build/source"
  echo "== building"
  inside build env CLEARANCE_BUILD_DIR=/build \
    CLEARANCE_CMAKE_ARGS="-DCLEARANCE_TESTS=OFF -DCMAKE_INSTALL_PREFIX=/usr/local" \
    bash /source/docker/build.sh >"$work/build.out" 2>"$work/build.err" || {
    tail -n 30 "$work/build.err" >&2
    exit 1
  }
  inside build env DESTDIR=/image cmake --install /build --strip >/dev/null
}
if [ -n "$built" ]; then
  mkdir -p "$work/build/image/usr/local/bin"
  for program in clearance_server clearance; do
    strip -o "$work/build/image/usr/local/bin/$program" "$built/bin/$program"
  done
else
  build_stage
fi

new_stage runtime
inside runtime bash /tmp/docker/install.sh runtime
cp -a "$work/build/image/usr/local/bin/." "$work/runtime/usr/local/bin/"
mkdir -p "$work/runtime/etc/clearance"
cp "$root/server/config/default.yaml" "$work/runtime/etc/clearance/config.yaml"
install -d -o 10001 -g 10001 "$work/runtime/data"

echo "== serving as user 10001 from the runtime stage"
env -i PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin chroot --userspec=10001:10001 "$work/runtime" \
  clearance_server --config /etc/clearance/config.yaml --listen 127.0.0.1:0 --http off \
  --socket /tmp/clearance.sock >"$work/server.log" 2>&1 &
server=$!
for _ in $(seq 100); do
  if grep -q '^ready' "$work/server.log"; then break; fi
  if ! kill -0 "$server" 2>/dev/null; then
    cat "$work/server.log" >&2
    exit 1
  fi
  sleep 0.1
done
inside runtime clearance --server /tmp/clearance.sock health
inside runtime clearance --server /tmp/clearance.sock info
kill -TERM "$server"
wait "$server"
echo "the image's recipe ends with a healthy server"
