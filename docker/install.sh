#!/usr/bin/env bash
# Installs the packages of the named sections of packages.txt, and nothing where all are there.
#
#   docker/install.sh SECTION...          install (root, or a sudo that asks for no password)
#   docker/install.sh --list SECTION...   print the packages
set -euo pipefail
exec </dev/null
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

list_only=false
if [ "${1-}" = --list ]; then
  list_only=true
  shift
fi
if [ $# -eq 0 ]; then
  echo "usage: $0 [--list] SECTION...   (sections: runtime, build, test, bench)" >&2
  exit 2
fi

packages=()
for section in "$@"; do
  if ! grep -qxF "[$section]" "$here/packages.txt"; then
    echo "$0: $here/packages.txt has no section [$section]" >&2
    exit 2
  fi
  while read -r package; do
    packages+=("$package")
  done < <(awk -v want="[$section]" '
    { sub(/#.*/, ""); gsub(/[ \t\r]/, "") }
    /^\[/ { in_section = ($0 == want); next }
    in_section && length' "$here/packages.txt")
done

if $list_only; then
  printf '%s\n' "${packages[@]}"
  exit 0
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "$0: needs Debian 12 with dpkg and apt-get; packages wanted: ${packages[*]}" >&2
  exit 1
fi
missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f '${db:Status-Abbrev}\n' "$package" 2>/dev/null || true)
  case $status in
    *ii*) ;;
    *) missing+=("$package") ;;
  esac
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    as_root=(sudo -n)
  else
    echo "$0: packages are missing and neither root nor a sudo without a password is at hand." >&2
    echo "Run once as root: apt-get update && apt-get install -y ${missing[*]}" >&2
    exit 1
  fi
fi
echo "Installing ${#missing[@]} packages: ${missing[*]}"
apt=(env DEBIAN_FRONTEND=noninteractive apt-get -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300)
"${as_root[@]}" "${apt[@]}" -qq update || {
  echo "$0: apt-get update failed: check the network and the apt sources of this machine." >&2
  exit 1
}
"${as_root[@]}" "${apt[@]}" install -y -qq --no-install-recommends "${missing[@]}" || {
  echo "$0: apt-get could not install: ${missing[*]} (Debian 12 \"bookworm\" has them all)" >&2
  exit 1
}
