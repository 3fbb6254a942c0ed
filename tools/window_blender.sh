#!/usr/bin/env bash
# A real Blender with a window for tests/gui, in a Debian of its own: tools/window_blender.sh SUITE
# SUITE: sid (Blender 5.2) or trixie (4.3). Needs root and debootstrap; 1.7 GB a suite, in a cache folder that
# lies outside the clone. Does nothing, at once, if it is there. Prints the folder.
set -eu -o pipefail
suite=${1:-sid}
cache=${DGS_WINDOW_CACHE:-$HOME/.cache/dgs-window}
root="$cache/$suite"
if [ -f "$root/.dgs-ready" ]; then
  echo "$root"
  exit 0
fi
[ "$(id -u)" = 0 ] || { echo "Only root can set up a Debian with Blender" >&2; exit 3; }
if ! command -v debootstrap >/dev/null; then
  apt-get update -qq >&2
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends debootstrap >&2 </dev/null
fi
# The machine's own mirror: no host is named here.
mirror=$(awk '/^URIs:/ {print $2; exit} /^deb / {for (i = 2; i <= NF; i++) if ($i ~ /^https?:/) {print $i; exit}}' \
  /etc/apt/sources.list.d/*.sources /etc/apt/sources.list 2>/dev/null | head -n 1)
[ -n "$mirror" ] || { echo "No Debian mirror in this machine's apt sources" >&2; exit 3; }
rm -rf --one-file-system "$root"
mkdir -p "$root"
debootstrap --variant=minbase --include=ca-certificates "$suite" "$root" "$mirror" >&2
mkdir -p "$root/etc/ssl/certs"
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
cp /etc/resolv.conf "$root/etc/" 2>/dev/null || true
# A mirror may be a snapshot that is older than its own expiry date.
echo 'Acquire::Check-Valid-Until "false";' >"$root/etc/apt/apt.conf.d/99snapshot"
chroot "$root" apt-get update -qq >&2
DEBIAN_FRONTEND=noninteractive chroot "$root" apt-get install -y -qq --no-install-recommends \
  blender python3-numpy python3-cattr python3-requests python3-zstandard python3-jsonschema \
  libegl1 libgl1-mesa-dri libegl-mesa0 libglx-mesa0 xvfb xdotool x11-apps imagemagick fonts-dejavu-core >&2 </dev/null
chroot "$root" apt-get clean
touch "$root/.dgs-ready"
echo "$root"
