"""Builds the Blender extension into dist/ with Blender's own tool, as found in pip's bpy."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

from tools import manual

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "dist"


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
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "download",
                "-q",
                "--disable-pip-version-check",
                "--no-deps",
                "--only-binary=:all:",
                "-d",
                str(wheel.parent),
                f"{name}=={version}",
            ],
            check=True,
        )
        if not wheel.is_file():
            sys.exit(f"pip fetched no '{wheel.name}'. Correct 'wheels' in blender_manifest.toml.")


def main() -> int:
    """Validates the manifest, builds the zip, validates the zip."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))
    fetch_wheels(manifest)
    manual.main()
    DIST.mkdir(exist_ok=True)
    archive = DIST / f"{manifest['id']}-{manifest['version']}.zip"
    tool = [sys.executable, str(blender_tool())]
    for arguments in (
        ["validate", str(ROOT)],
        ["build", "--source-dir", str(ROOT), "--output-filepath", str(archive)],
        ["validate", str(archive)],
    ):
        code = subprocess.run([*tool, *arguments], check=False).returncode
        if code:
            return code
    print(f"Built {archive.relative_to(ROOT)}")
    print("In Blender: Edit > Preferences > Get Extensions > Install from Disk")
    return 0


if __name__ == "__main__":
    sys.exit(main())
