"""Motion of the camera while the shutter was open: a straight path of every photo's own."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..composed import moved
from ..psf import PointSpread
from .effect import Effect, Shot, index_of

#: Paths below this length (px) blur less than the pixels themselves: such a photo keeps the medium's point spread.
LEAST = 1.0


class Motion(Effect):
    """The point spread of each photo, convolved with a uniform straight line.

    `paths` [V, 2]: length (px of the photos as loaded) and direction (degrees from x towards y) of V photos. Photos
    that are not named, or whose path is shorter than `LEAST`, keep the medium's own point spread.
    """

    name = "motion"
    physics = "A camera that moves while its shutter is open smears each photo along the path that it took."
    place = "kernel"
    #: A line is not separable: the blur and its transpose go by transforms, 5 log2(800 x 533) each there and back.
    multiplications = 190

    def __init__(self, names: Sequence[str], paths: Tensor) -> None:
        super().__init__({"paths": paths})
        self.names = tuple(names)

    def point_spread(self, psf: PointSpread | None, name: str) -> PointSpread | None:
        """See `Effect`."""
        length, angle = self._path(name)
        return psf if length < LEAST else moved(psf, length, angle)

    def kernel_text(self, name: str, scale: float) -> str:
        """See `Effect`."""
        length, angle = self._path(name)
        return "" if length < LEAST else f"path:{scale * length:.6g},{angle:.6g}"

    def _path(self, name: str) -> tuple[float, float]:
        index = index_of(self.names, name)
        length, angle = (0.0, 0.0) if index is None else (float(value) for value in self.parameters["paths"][index])
        return length, angle

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """The very same light: the path is in the point spread."""
        return light

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """The very same gradient; paths are told before the training and stay."""
        return upstream

    @property
    def finest(self) -> float:
        """Median length (px) of the paths that blur: what a photo must be large enough to show."""
        lengths = self.parameters["paths"][:, 0]
        longer = lengths[lengths >= LEAST]
        return float(longer.median()) if len(longer) else 0.0

    def described(self) -> dict[str, object]:
        """Length (px) and direction (degrees) by photo."""
        paths = self.parameters["paths"].detach().cpu()
        return {name: [round(float(v), 2) for v in row] for name, row in zip(self.names, paths, strict=True)}


def motion_from(names: Sequence[str], lengths: Sequence[float], angles: Sequence[float]) -> Motion:
    """The effect from lengths (px) and directions (degrees)."""
    return Motion(names, torch.tensor([list(pair) for pair in zip(lengths, angles, strict=True)], dtype=torch.float32))
