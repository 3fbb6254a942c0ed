"""The forward model: from Gaussians to what a camera files of them, each part with its gradient.

    Gaussians, camera --> sharp --> reached --> degraded --> photo
               (rasterizer)   (effects in    (medium)   (effects of lens
                               front of it)              and sensor)

`ForwardModel.expose` takes one photo's light along it; `compare` says how far the result is from the photo. Nothing
else in the engine renders, blurs or compares (a test reads the imports).
"""

from __future__ import annotations

from .medium import FixedMedium, MediumModel, SubFrame, kept_mediums, medium_of, shared_medium, space_of
from .model import Exposed, Exposure, ForwardModel, sharp_depths, sharp_view
from .sampling import SAMPLING, SamplingSettings, low_pass_on_grid, margin_for
from .surface import surface_seen

__all__ = [
    "SAMPLING",
    "Exposed",
    "Exposure",
    "FixedMedium",
    "ForwardModel",
    "MediumModel",
    "SamplingSettings",
    "SubFrame",
    "kept_mediums",
    "low_pass_on_grid",
    "margin_for",
    "medium_of",
    "sharp_depths",
    "sharp_view",
    "shared_medium",
    "surface_seen",
    "space_of",
]
