"""Builds the Blender extension into dist/ with Blender's own tool, as found in pip's bpy.

    .venv/bin/python -m tools.extension [--wheels]

`--wheels` fetches the wheels that go into it and builds nothing: `make setup` does so while there is a network.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

from filelock import FileLock

from tools import manual

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "dist"
#: Times that a wheel is asked for, and seconds before it is asked for again: a package index may fail for a moment.
ATTEMPTS, PAUSE = 4, 5.0


def blender_tool() -> Path:
    """Blender's extension tool inside the installed bpy, found without loading bpy."""
    found = importlib.util.find_spec("bpy")
    folder = Path(found.origin).parent if found and found.origin else DIST
    tools = sorted(folder.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if not tools:
        sys.exit("bpy is not installed, or has no extension tool. Run 'make setup'.")
    return tools[-1]


def fetch_wheels(manifest: dict[str, Any]) -> None:
    """Puts the wheels that the manifest lists where it lists them."""
    for listed in manifest.get("wheels", []):
        wheel = ROOT / listed
        if wheel.is_file():
            continue
        name, version = wheel.stem.split("-")[:2]
        print(f"Fetching {name} {version}", flush=True)
        arguments = ["download", "-q", "--disable-pip-version-check", "--no-deps", "--only-binary=:all:"]
        for attempt in range(ATTEMPTS):
            time.sleep(PAUSE * bool(attempt))
            code = subprocess.run(
                [sys.executable, "-m", "pip", *arguments, "-d", str(wheel.parent), f"{name}=={version}"], check=False
            ).returncode
            if not code:
                break
        if code:
            sys.exit(f"pip could not fetch '{wheel.name}'; its reason stands above. Try again with a network.")
        if not wheel.is_file():
            sys.exit(f"pip fetched no '{wheel.name}'. Correct 'wheels' in blender_manifest.toml.")


def main() -> int:
    """Validates the manifest, builds the zip, validates the zip; one process at a time, as all write the same files."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))
    DIST.mkdir(exist_ok=True)
    with FileLock(DIST / "building.lock"):
        fetch_wheels(manifest)
        return 0 if "--wheels" in sys.argv[1:] else build(manifest)


def build(manifest: dict[str, Any]) -> int:
    """Builds the zip, validates it, and puts it in its place at once; the status of Blender's tool."""
    manual.main()
    archive = DIST / f"{manifest['id']}-{manifest['version']}.zip"
    draft = DIST / "draft.zip"
    tool = [sys.executable, str(blender_tool())]
    for arguments in (
        ["validate", str(ROOT)],
        ["build", "--source-dir", str(ROOT), "--output-filepath", str(draft)],
        ["validate", str(draft)],
    ):
        code = subprocess.run([*tool, *arguments], check=False).returncode
        if code:
            return code
    draft.replace(archive)
    print(f"Built {archive.relative_to(ROOT)}")
    print("In Blender: Edit > Preferences > Get Extensions > Install from Disk")
    return 0


if __name__ == "__main__":
    sys.exit(main())
