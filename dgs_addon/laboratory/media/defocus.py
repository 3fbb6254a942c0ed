"""A lens with a hole, focused anew for each photo: a point out of focus becomes a disc.

    diameter in px = A f |1 / focus - 1 / z|

A: diameter of the hole, f: focal length in px, z: depth along the axis. All photos share the hole.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....core.camera import Camera
from ....core.errors import DgsError
from .medium import Medium, MediumSpec, Stage, Truth, Views, generator, numbers, span

FORM = "PX[,NEAR..FAR]"
#: Shares of a view's pixels that are nearer and not farther: a few pixels of the horizon decide nothing.
_NEAREST, _FARTHEST = 0.05, 0.95
#: Diameter (px) that no circle exceeds: beyond, Cycles gives up counting f-numbers.
_WIDEST = 1000.0


@dataclass(frozen=True)
class Defocus(Medium):
    """Depth of field.

    Attributes:
        largest: diameter in px of the largest disc in any photo (but for the nearest and farthest twentieth of it).
        near, far: depths between which each photo's focus is drawn; 0 takes those in the middle of the photo.
    """

    largest: float
    near: float
    far: float
    every_photo = False

    def constants(self) -> Truth:
        """How the circles follow from what each photo says."""
        return {
            "largest_px": self.largest,
            "circle": "diameter in px = scale |1 / focus - 1 / z|; z, focus: depth along the axis; "
            "scale = aperture times focal length in px",
        }

    def plan(self, views: Views) -> list[Truth]:
        """Focus for each photo, drawn evenly in 1 / depth, and the hole that gives the largest disc."""
        ends, focus = [], []
        for index, depth in enumerate(views.depths()):
            rows, columns = depth.shape
            middle = depth[rows // 4 : -(rows // 4), columns // 4 : -(columns // 4)]
            low, high = (self.near, self.far) if self.far > 0 else _ends(middle)
            ends.append(_ends(depth))
            focus.append(1 / generator(views.seed, "defocus", index).uniform(1 / high, 1 / low))
        widest = max(
            camera.fx * abs(1 / z - 1 / sharp)
            for camera, (near, far), sharp, clear in zip(views.cameras, ends, focus, views.clear, strict=True)
            for z in (near, far)
            if not clear or all(views.clear)
        )
        if widest == 0:
            raise DgsError("Everything is at the depth that is in focus", "Give defocus:PX,NEAR..FAR with other depths")
        hole = self.largest / widest
        return [
            {"focus": sharp, "aperture": hole, "scale": hole * camera.fx}
            for camera, sharp in zip(views.cameras, focus, strict=True)
        ]

    def photo(self, stage: Stage, camera: Camera, truth: Truth) -> AbstractContextManager[None]:
        """The photo's lens."""
        return stage.lens(camera, truth["aperture"], truth["focus"])


def _ends(depth: NDArray[np.float32]) -> tuple[float, float]:
    """Depths between which nearly all of what is seen lies."""
    seen = depth[np.isfinite(depth)]
    if not seen.size:
        raise DgsError("A view sees nothing that could be in focus", "Give defocus:PX,NEAR..FAR, or another --path")
    near, far = np.quantile(seen, (_NEAREST, _FARTHEST))
    return float(near), float(far)


def _parse(text: str) -> Medium:
    size, comma, depths = text.partition(",")
    (largest,) = numbers("defocus", FORM, size, 1, 1)
    near, far = span("defocus", FORM, depths) if comma else (0.0, 0.0)
    if not largest > 0:
        raise DgsError(f"Circles of {largest:g} px are a pinhole's", "Give defocus:10, or leave the medium out")
    if largest > _WIDEST:
        raise DgsError(f"Circles of {largest:g} px are wider than any photo", f"Give at most {_WIDEST:g} px")
    if comma and not near > 0:
        raise DgsError("A lens focuses before the camera", "Give depths above 0, such as defocus:10,0.5..0.9")
    return Defocus(largest, near, far)


SPEC = MediumSpec(
    "defocus",
    "Depth of Field",
    "A lens with a real aperture, focused at another distance in each photo",
    FORM,
    "8",
    _parse,
)
