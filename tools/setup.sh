#!/usr/bin/env bash
# Creates .venv with the pinned packages, and the system libraries that Blender's module needs.
# Does nothing, at once, if that was done for the same requirements before.
set -eu -o pipefail
cd "$(dirname "$0")/.."

VENV=.venv
WANTED=$(cat requirements.txt requirements-dev.txt requirements.lock tools/setup.sh tools/system_libraries.py | sha256sum | cut -c1-16)
STAMP="$VENV/installed-$WANTED"
[ -f "$STAMP" ] && [ -x "$VENV/bin/python" ] && exit 0

say() { printf '\033[1m== %s\033[0m\n' "$*"; }

# Installs Debian packages if we may; otherwise says what to run, and stops.
apt_install() {
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    say "Installing system packages: $*"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" </dev/null >/dev/null
  else
    echo "System packages are missing. Run this line, then make again:" >&2
    echo "    sudo apt-get update && sudo apt-get install -y $*" >&2
    exit 1
  fi
}

python_311() {  # a Python 3.11; bpy's wheels fit no other
  for candidate in "${PYTHON:-}" python3.11 python3 python; do
    [ -n "$candidate" ] || continue
    if "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
}

python=$(python_311)
if [ -z "$python" ]; then
  if apt-cache show python3.11 >/dev/null 2>&1; then
    apt_install python3.11 python3.11-venv
    python=python3.11
  else
    echo "Python 3.11 was not found. Install it, then run: make setup PYTHON=/path/to/python3.11" >&2
    exit 1
  fi
fi

if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
  apt_install python3.11-venv
fi

if ! "$VENV/bin/python" -c 'import pip' 2>/dev/null; then
  say "Creating $VENV with $("$python" --version)"
  "$python" -m venv --clear "$VENV"
fi

say "Installing the pinned packages into $VENV (about 2.5 GB, 1 to 5 minutes)"
# pip draws its own progress bars on a terminal; elsewhere one line a package is progress enough.
install=("$VENV/bin/python" -m pip install --disable-pip-version-check --no-input --root-user-action=ignore
  -r requirements-dev.txt -c requirements.lock)
if [ -t 1 ]; then
  "${install[@]}"
else
  "${install[@]}" --progress-bar off | awk '/^(Collecting|Installing|Successfully)/ { print substr($0, 1, 100); fflush() }'
fi

missing=$("$VENV/bin/python" tools/system_libraries.py)
# shellcheck disable=SC2086  # one word per package is meant
[ -z "$missing" ] || apt_install $missing

# A Vulkan driver that computes on the CPU stands in for a graphics card, so that the tests of the gpu back end run
# everywhere. They are skipped without it: it is not worth a set-up that fails.
if ! compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null && ! compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null; then
  (apt_install mesa-vulkan-drivers) ||
    echo "Without a Vulkan driver the tests of the gpu back end are skipped; nothing else needs it." >&2
fi

"$VENV/bin/python" -c 'import bpy, numba, pycolmap, torch' ||
  { echo "A package does not load; see the message above." >&2; exit 1; }
# The extension's own wheels, while there is a network (it asks for them again if they are not there).
"$VENV/bin/python" -m tools.extension --wheels
rm -f "$VENV"/installed-*
touch "$STAMP"
say "Ready: $VENV"
