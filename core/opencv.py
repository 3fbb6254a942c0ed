"""OpenCV: loaded where it is used only, as little needs it and other versions may stand in its place."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import DgsError

PACKAGE = "opencv-python-headless"


def opencv(wanted_by: str, otherwise: str = "") -> Any:
    """The module cv2.

    Args:
        wanted_by: what needs it, in the plural; otherwise: a way that goes without, as the end of a sentence.

    Raises:
        DgsError: it is missing.
    """
    try:
        return importlib.import_module("cv2")
    except ImportError as error:
        raise DgsError(f"{wanted_by} need the package {PACKAGE} ({error})", way_out(otherwise)) from error


def way_out(otherwise: str = "") -> str:
    """What whoever misses it can do."""
    return f"Install the engine again, or run: python -m pip install {PACKAGE}{otherwise and '; or ' + otherwise}"
