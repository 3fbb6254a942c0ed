"""All effects of image formation that can be simulated: a new one is one file and one line."""

from __future__ import annotations

from .effect import Effect
from .exposure import Exposure
from .haze import Haze
from .motion import Motion
from .vignetting import Vignetting

EFFECTS: dict[str, type[Effect]] = {effect.name: effect for effect in (Haze, Motion, Vignetting, Exposure)}
