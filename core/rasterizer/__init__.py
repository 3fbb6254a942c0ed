"""Gaussians and a camera in, an image out: one door, three back ends.

    rendered = render(gaussians, camera)
    rendered.image.sum().backward()

`reference` (plain torch) is the specification, `cpu` (numba) and `cuda` (gsplat) mirror it.
"""

from __future__ import annotations

from .interface import BACKENDS, RasterSettings, Rendered, ScreenStatistics, render
from .slope import with_slope

__all__ = ["BACKENDS", "RasterSettings", "Rendered", "ScreenStatistics", "render", "with_slope"]
