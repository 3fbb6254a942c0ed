"""OpenCV, whose detector finds printed markers."""

from __future__ import annotations

from typing import Any

from ..errors import DgsError
from ..opencv import opencv, way_out

_OTHERWISE = "give a known length instead"


def opencv_with_markers() -> Any:
    """The module cv2; raises DgsError where it, or its part for markers, is missing."""
    library = opencv("Marker boards", _OTHERWISE)
    if not hasattr(getattr(library, "aruco", None), "CharucoDetector"):
        version = getattr(library, "__version__", "of another kind")
        raise DgsError(f"This OpenCV ({version}) finds no markers", way_out(_OTHERWISE))
    return library
