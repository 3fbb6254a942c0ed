"""All effects of image formation that can be simulated: a new one is one file and one line."""

from __future__ import annotations

from .defocus import Defocus
from .effect import Effect
from .exposure import Exposure
from .field_blur import FieldBlur
from .haze import Haze
from .motion import Motion
from .vignetting import Vignetting

# In the order in which light meets them, but for one thing: the lens comes behind the medium that blurs. Its blur is
# simulated in front of that one, where the frames have a margin and their depth; Gaussians commute where their widths
# change slowly.
EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect for effect in (Haze, Defocus, FieldBlur, Motion, Vignetting, Exposure)
}
