"""All effects that can be inspected, in the order in which light meets them: a new one is one file and one line."""

from __future__ import annotations

from collections.abc import Callable

from .effects import (
    blur,
    defocus,
    exposure,
    field_blur,
    gloss,
    haze,
    lens,
    motion,
    noise,
    saturation,
    vignetting,
    white_balance,
)
from .evidence import Evidence
from .photo_set import PhotoSet

INSPECTIONS: dict[str, Callable[[PhotoSet], Evidence]] = {
    "view_dependence": gloss.inspect,
    "haze": haze.inspect,
    "blur": blur.inspect,
    "field_blur": field_blur.inspect,
    "defocus": defocus.inspect,
    "motion": motion.inspect,
    "lens_distortion": lens.inspect,
    "vignetting": vignetting.inspect,
    "exposure": exposure.inspect,
    "white_balance": white_balance.inspect,
    "noise": noise.inspect,
    "saturation": saturation.inspect,
}
