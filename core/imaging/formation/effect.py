"""What every effect of image formation can do: all that a training and the forward model know of one.

Loads no torch by itself, so that what lists effects (`--help`, Blender's panel) stays quick.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class Shot:
    """One photo that is being formed.

    Attributes:
        name: the photo's.
        height, width: of the photo, px; frames with a margin are larger by 2 margin.
        margin: px around the photo.
        middle: (column, row) of the optical axis, px of the photo.
        depth: [H + 2m, W + 2m] of the sharp render along the optical axis, in median depths; None if not at hand.
    """

    name: str
    height: int
    width: int
    margin: int = 0
    middle: tuple[float, float] | None = None
    depth: Tensor | None = field(default=None, repr=False)

    @property
    def diagonal(self) -> float:
        """Of the photo, px: what lengths are a share of, as it is the same for a camera held upright."""
        return math.hypot(self.width, self.height)


class Effect(ABC):
    """One effect on linear light.

    Attributes:
        name: as `--effects` takes it; physics: one sentence; place: 'camera' where it changes what frames a
            photo collects and leaves their light alone, 'light' before the medium's blur (frames with margin), 'sensor'
            behind it (the photo's own px).
        by_depth: whether it needs the render's depth; by_surface: whether that is to be the surface's, not the mean of
            what is seen (`core.forward.surface`).
        parameters: float32 tensors; gradients: of the loss, of the same shapes, added up by `gradient`.
        depth_gradient: [h, w] of the loss in the render's depth, as `gradient` left it; None where it goes to none.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    place: ClassVar[Literal["camera", "light", "sensor"]]
    by_depth: ClassVar[bool] = False
    by_surface: ClassVar[bool] = False
    depth_gradient: Tensor | None = None

    def __init__(self, parameters: dict[str, Tensor]) -> None:
        self.parameters = parameters
        self.gradients: dict[str, Tensor] = {}

    @abstractmethod
    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """[3, h, w] linear light in, the same out; differentiable in `light` and in `parameters`."""

    @abstractmethod
    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """Gradient of the loss in `light`, given that in the output; adds those in the parameters to `gradients`."""

    def reach(self, diagonal: float) -> float:
        """Standard deviation (px) of what spreads light from outside into a photo of this diagonal, px."""
        return 0.0

    def undone(self, light: Tensor, shot: Shot) -> Tensor:
        """The inverse, for effects of the sensor: what would have been there without it."""
        raise NotImplementedError(f"'{self.name}' cannot be undone on a photo")

    def settle(self) -> None:  # noqa: B027 (most effects have no gauge)
        """Puts parameters that the photos cannot distinguish from the scene's onto their convention."""

    def described(self) -> Mapping[str, object]:
        """Parameters for reports, as plain numbers."""
        return {name: value.detach().cpu().numpy().round(5).tolist() for name, value in self.parameters.items()}

    def _add(self, name: str, value: Tensor) -> None:
        self.gradients[name] = value if name not in self.gradients else self.gradients[name] + value


def index_of(names: Sequence[str], name: str) -> int | None:
    """Where a photo stands, or None for one that the effect does not name."""
    try:
        return list(names).index(name)
    except ValueError:
        return None


def radius2(shot: Shot, like: Tensor) -> Tensor:
    """[h, w] squared distance from the photo's middle over half its diagonal, on a frame [3, h, w] with its margin."""
    y, x = off_axis(shot, like)
    return ((y**2)[:, None] + (x**2)[None, :]) / (shot.diagonal / 2) ** 2


def off_axis(shot: Shot, like: Tensor) -> tuple[Tensor, Tensor]:
    """Px from the photo's middle of the rows [h] and of the columns [w] of a frame [3, h, w] with its margin."""
    import torch  # heavy

    x0, y0 = shot.middle or (shot.width / 2, shot.height / 2)
    margin_y, margin_x = (like.shape[1] - shot.height) // 2, (like.shape[2] - shot.width) // 2
    y = torch.arange(like.shape[1], device=like.device, dtype=like.dtype) + 0.5 - margin_y - y0
    x = torch.arange(like.shape[2], device=like.device, dtype=like.dtype) + 0.5 - margin_x - x0
    return y, x
