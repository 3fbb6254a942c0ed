"""Even fog in a box around the object and the cameras: light is scattered on its way, none is absorbed."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from ....core.errors import DgsError
from ...axes import points_to_blender
from .medium import Medium, MediumSpec, Stage, Truth, Views, numbers

FORM = "PER_METRE[,G]"
#: Half the side of the box, in viewing distances: nearly all that is seen is inside.
_REACH = 4.0


@dataclass(frozen=True)
class Fog(Medium):
    """A homogeneous scattering volume.

    Attributes:
        density: scattering coefficient per unit of length.
        anisotropy: Henyey and Greenstein's g, -1 (back) to 1 (on).
    """

    density: float
    anisotropy: float
    every_photo = True

    def constants(self) -> Truth:
        """What the light meets."""
        return {
            "scattering_per_unit": self.density,
            "anisotropy": self.anisotropy,
            "contrast": "exp(-scattering_per_unit times the way to the camera), inside the box",
        }

    def plan(self, views: Views) -> list[Truth]:
        """The box, the same for all photos."""
        distance = float(np.median([np.linalg.norm(camera.centre - views.target) for camera in views.cameras]))
        box = {"box_middle": views.target.tolist(), "box_half_side": _REACH * distance}
        return [box for _ in views.cameras]

    def standing(self, stage: Stage, plan: list[Truth]) -> AbstractContextManager[None]:
        """The box of fog."""
        middle = points_to_blender(plan[0]["box_middle"])
        return stage.fog(self.density, self.anisotropy, middle, plan[0]["box_half_side"])


def _parse(text: str) -> Medium:
    values = numbers("fog", FORM, text, 1, 2)
    density, anisotropy = (*values, 0.0)[:2]
    if not density > 0:
        raise DgsError(f"Fog of {density:g} per metre is clear air", "Give fog:0.5, or leave the medium out")
    if not -0.99 <= anisotropy <= 0.99:
        raise DgsError(f"Light cannot be scattered with g = {anisotropy:g}", "Give fog:0.5,G with G from -0.99 to 0.99")
    return Fog(density, anisotropy)


SPEC = MediumSpec("fog", "Fog", "A real volume of even fog: slow, and noisy without many samples", FORM, "0.5", _parse)
