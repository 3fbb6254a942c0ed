"""OpenCV, whose detector finds printed markers: loaded where it is used only, as nothing else needs it."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import DgsError

_PACKAGE = "opencv-python-headless"


def opencv() -> Any:
    """The module cv2; raises DgsError where it, or its part for markers, is missing."""
    try:
        library: Any = importlib.import_module("cv2")
    except ImportError as error:
        raise DgsError(f"Marker boards need the package {_PACKAGE} ({error})", _way_out()) from error
    if not hasattr(getattr(library, "aruco", None), "CharucoDetector"):
        version = getattr(library, "__version__", "of another kind")
        raise DgsError(f"This OpenCV ({version}) finds no markers", _way_out())
    return library


def _way_out() -> str:
    return f"Install the engine again, or run: python -m pip install {_PACKAGE}; or give a known length instead"
