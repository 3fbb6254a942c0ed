"""Which Python runs the engine."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DeviceError
from ...core.photos.kinds import HEIF_PACKAGE
from ..engine_sentences import in_users_language
from .folder import engine_folder, engine_python, is_installed

#: Python to use before all others, for tests and for many machines set up alike.
VARIABLE = "DGS_ENGINE_PYTHON"
_CLONE = Path(__file__).resolve().parents[2]


def preferences() -> Any:
    """The add-on's preferences, or None where it is not enabled as an add-on (in a script)."""
    package = __package__.rsplit(".dgs_addon", 1)[0]
    addon = bpy.context.preferences.addons.get(package)
    return addon.preferences if addon is not None else None


def find_python() -> Path:
    """The engine's Python: as the preferences say, installed by the button, a clone's own, or this one.

    Raises:
        DeviceError: there is none; it says what to do.
    """
    chosen = preferences()
    for text in (os.environ.get(VARIABLE, ""), chosen.python if chosen is not None else ""):
        if text.strip():
            path = Path(bpy.path.abspath(text))
            if not _is_file(path):
                raise DeviceError(f"The engine's Python '{path}' is not there", "Correct it in the preferences")
            return path
    if engine_folder() is not None and is_installed():
        return engine_python()
    clone = _CLONE / ".venv" / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    if clone.is_file():
        return clone
    # pip's bpy: this very Python may hold the engine's packages.
    if getattr(bpy.app, "module", False) and find_spec("torch") is not None:
        return Path(sys.executable)
    raise DeviceError("The engine is not installed", "Press Install Engine in the add-on's preferences")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # no file can be called so
        return False


def reads_heif() -> bool:
    """Whether the engine's Python has the package that reads HEIC; a Python of another layout has not.

    Its library is looked at, not asked: that would take seconds.
    """
    try:
        python = find_python()
        if python == Path(sys.executable):
            return find_spec(HEIF_PACKAGE) is not None
        libraries = [*python.parent.parent.glob("lib/python3*/*-packages"), python.parent.parent / "Lib/site-packages"]
        return any((library / HEIF_PACKAGE).is_dir() for library in libraries)
    except (DeviceError, OSError):
        return False


def why_not() -> str:
    """Why no engine can be started; '' if one can. Cheap enough for a panel."""
    try:
        find_python()
    except DeviceError as error:
        return in_users_language(str(error))
    return ""
