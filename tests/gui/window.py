"""Starts a real Blender with a window, in the Debian that tools/window_blender.sh has set up.

Everything is mounted in a namespace of its own, which ends with the last process in it: nothing can
be left mounted, and so nothing of the host can be deleted with the Debian. Its network is its own too, and so is
its display, however many run at once.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import dgs
import pytest
from dgs.core.version import VERSION

ROOT = Path(dgs.__path__[0])
#: The Debian whose Blender is asked for: sid (5.2) or trixie (4.3).
SUITE = os.environ.get("DGS_WINDOW", "")
_CACHE = Path(os.environ.get("DGS_WINDOW_CACHE", Path.home() / ".cache" / "dgs-window"))
#: Screen of the virtual display in px.
SCREEN = (1600, 900)

# $1: the Debian; $2: the work folder, at the same path inside; then the command.
_NAMESPACE = """
set -eu
root=$1 work=$2; shift 2
mount --make-rprivate /
mkdir -p "$root/host" "$root$work" "$root/proc" "$root/dev"
mount --bind / "$root/host"
mount -t proc proc "$root/host/proc"
mount --rbind /dev "$root/host/dev"
mount --bind "$work" "$root$work"
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
exec chroot "$root" "$@"
"""

# A display for as long as the command runs.
_DISPLAY = """
set -eu
rm -f /tmp/.X99-lock /tmp/.X11-unix/X99  # of a display that was killed
Xvfb :99 -screen 0 {width}x{height}x24 +extension GLX >/dev/null 2>&1 &
server=$!
trap 'kill $server' EXIT
for _ in $(seq 50); do [ -e /tmp/.X11-unix/X99 ] && break; sleep 0.1; done
{command}
"""


def why_not(suite: str) -> str:
    """Why no Blender with a window can be started; '' if one can."""
    if not (_CACHE / suite / ".dgs-ready").is_file():
        return f"no Blender with a window: run tools/window_blender.sh {suite} as root"
    if os.geteuid() != 0 or shutil.which("unshare") is None:
        return "a Blender with a window needs root, to enter its Debian"
    return ""


def environment(work: Path) -> dict[str, str]:
    """A Blender with empty preferences, whose engine runs in this process's Python, outside its Debian."""
    engine = work / "engine-python"
    if not engine.exists():
        engine.write_text(f'#!/bin/sh\nexec chroot /host {shlex.quote(sys.executable)} "$@"\n', encoding="utf-8")
        engine.chmod(0o755)
    resources = work / "resources"
    resources.mkdir(exist_ok=True)
    (work / "tmp").mkdir(exist_ok=True)  # /tmp is another one for the engine
    return {
        "PATH": "/usr/local/bin:/usr/bin:/bin:/usr/games:/usr/sbin:/sbin",
        "HOME": str(work),
        "LANG": "C.UTF-8",
        "TMPDIR": str(work / "tmp"),
        "DISPLAY": ":99",
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "BLENDER_USER_RESOURCES": str(resources),
        "DGS_ENGINE_PYTHON": str(engine),
        "OMP_WAIT_POLICY": "passive",
    }


def run(suite: str, work: Path, command: list[str], seconds: float, window: bool = True) -> str:
    """Runs a command inside and returns what it said.

    Raises:
        RuntimeError: it failed or took too long; with its words.
    """
    line = shlex.join(command)
    if window:
        line = _DISPLAY.format(width=SCREEN[0], height=SCREEN[1], command=line)
    process = subprocess.Popen(
        [
            "unshare",
            "-m",
            "-n",
            "-p",
            "-f",
            "--kill-child",
            "bash",
            "-c",
            _NAMESPACE,
            "bash",
            str(_CACHE / suite),
            str(work),
            "bash",
            "-c",
            line,
        ],
        env=environment(work),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    try:
        words = process.communicate(timeout=seconds)[0]
    except subprocess.TimeoutExpired:
        process.kill()
        raise RuntimeError(f"not done in {seconds:.0f} s: {process.communicate()[0][-3000:]}") from None
    finally:
        process.kill()  # where the test itself was stopped
    if process.returncode:
        raise RuntimeError(f"status {process.returncode}: {words[-3000:]}")
    return words


def skip_unless_asked() -> None:
    """Skips where no Blender with a window was asked for, or none is there."""
    reason = why_not(SUITE) if SUITE else "DGS_WINDOW names no Blender with a window (see this file)"
    if reason:
        pytest.skip(reason)


def play(work: Path, story: str, seconds: float) -> None:
    """Installs the extension in an empty Blender and plays a story of this folder in it; what it said goes to words.

    DGS_WINDOW_PICTURES names a folder where the screenshots in WORK/pictures are kept.

    Raises:
        RuntimeError: as `run`.
    """
    subprocess.run([sys.executable, "-m", "tools.extension"], cwd=ROOT, check=True, capture_output=True)
    package = shutil.copy(ROOT / "dist" / f"dgs-{VERSION}.zip", work)
    for name in ("robot.py", "stage.py", story):
        shutil.copy(ROOT / "tests" / "gui" / name, work)
    install = ["blender", "--command", "extension", "install-file", "-r", "user_default", "--enable", package]
    run(SUITE, work, install, 120, window=False)
    size = ["--window-geometry", "0", "0", *map(str, SCREEN)]
    played = ["blender", *size, "--python", str(work / story), "--", str(work)]
    (work / "words").write_text(run(SUITE, work, played, seconds), "utf-8")
    kept = os.environ.get("DGS_WINDOW_PICTURES")
    if kept:
        shutil.copytree(work / "pictures", kept, dirs_exist_ok=True)
