"""The engine from Python: for notebooks and scripts, arrays in and out.

    from dgs.api import Twin, measure_psf, reconstruct

    kernel = measure_psf(photo_of_a_pinhole).kernel       # [K, K]
    twin = reconstruct(photos, "out", psf=kernel)         # photos: a folder, or arrays [H, W, 3] by name
    picture = twin.render(twin.names[0])                  # [H, W, 3] float32, sRGB in [0, 1]
    again = Twin.open("out")

What goes wrong is a `DgsError`: what happened, and the way out.
"""

from __future__ import annotations

from ..core.errors import DgsError
from .calibration import measure_psf
from .reconstruct import reconstruct
from .twin import Twin, render

__all__ = ["DgsError", "Twin", "measure_psf", "reconstruct", "render"]
