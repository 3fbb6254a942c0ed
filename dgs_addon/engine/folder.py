"""Where the add-on keeps the engine that it installed: in the extension's own user folder."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import bpy

REQUIREMENTS = Path(__file__).with_name("requirements.txt")


def engine_folder() -> Path | None:
    """The environment's folder; None where the add-on does not run as an extension and so has none."""
    try:
        return Path(bpy.utils.extension_path_user(__package__.rsplit(".dgs_addon", 1)[0], path="engine"))
    except ValueError:
        return None


def engine_python() -> Path:
    """The Python inside the folder, there or not.

    Raises:
        RuntimeError: this is no extension.
    """
    folder = engine_folder()
    if folder is None:
        raise RuntimeError("only extensions have a folder of their own")
    return python_in(folder)


def python_in(folder: Path) -> Path:
    """A virtual environment's Python."""
    return folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def stamp(folder: Path, requirements: Path) -> Path:
    """The file that says that everything is there, for these requirements and this Python."""
    wanted = requirements.read_bytes() + f"{sys.version_info[:2]}".encode()
    return folder / f"installed-{hashlib.sha256(wanted).hexdigest()[:16]}"


def is_installed() -> bool:
    """Whether the engine is there as this version of the add-on needs it."""
    folder = engine_folder()
    return folder is not None and stamp(folder, REQUIREMENTS).is_file() and python_in(folder).is_file()
