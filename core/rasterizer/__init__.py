"""Gaussians and a camera in, an image out: one door, a few back ends (`core.devices`).

    rendered = render(gaussians, camera)
    rendered.image.sum().backward()

`reference` (plain torch) is the specification, `cpu` (numba) and `gpu` (shaders) mirror it.
"""

from __future__ import annotations

from ..rendering import RasterSettings, Rendered, RenderedLayers, RenderedPath, ScreenStatistics
from .depths import Depths, blended_depths, surface_of_centres
from .given_gradient import with_gradient
from .interface import render, render_layers, render_path
from .projection import bare_footprints

__all__ = [
    "Depths",
    "RasterSettings",
    "Rendered",
    "RenderedLayers",
    "RenderedPath",
    "ScreenStatistics",
    "bare_footprints",
    "blended_depths",
    "render",
    "render_layers",
    "render_path",
    "surface_of_centres",
    "with_gradient",
]
