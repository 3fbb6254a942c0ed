"""A straight piece of a line as its photo shows it: profiles across it, side by side."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..colour import srgb_to_linear
from ..evaluation.profiles import Sampler
from ..imaging.medium import BlurSpace
from ..numbers import number
from .line_spread import LineSpread, line_spread
from .request import Point
from .sights import Sight

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineProfileSettings:
    """How large a piece is looked at."""

    piece: float = number(
        3.0,
        "standard deviations of the blur",
        "of the line that are looked at along it: with 4 its ends and bends shine in more often (8 px: 75 % of the"
        " intervals hold), and nothing is more exact",
        "lines of 4 to 16 px through 5 and 8 px (benchmarks/lined_wall.py, seed 0)",
        "the same through 2 and 3 px, and another wall (seed 1)",
    )
    shortest: int = number(7, "px", "the same, at least")
    beyond: float = number(2.0, "standard deviations of the blur", "that profiles go on beyond both points")
    steepest: float = number(0.4, "tangent", "that profiles are turned by, at most")
    margin: int = number(
        12, "px", "of a photo around what is read: splines of the third degree forget their border within"
    )


SETTINGS = LineProfileSettings()


@dataclass(frozen=True)
class LineProfiles:
    """What a photo shows across a line.

    Attributes:
        places: [N] px across the line, from the middle between the points.
        block: [N, L, 3] L profiles 1 px apart, in the space that the blur acts in.
        spread: of the blur.
    """

    places: Array = field(repr=False)
    block: Array = field(repr=False)
    spread: LineSpread = field(repr=False)


def line_profiles(
    sight: Sight, across: tuple[Point, Point], space: BlurSpace = "srgb", slope: float = 0.0
) -> LineProfiles | None:
    """What a photo shows of a line between two points.

    None where its blur is not known as a point spread, or the piece is not wholly on the photo.

    Args:
        across: points on both sides of the line, px of the undistorted view.
        space: that the blur acts in.
        slope: px that the line moves across for each px along it, where it does not stand upright between the points.
    """
    blur = None if sight.view is None else sight.view.psf
    if blur is None:
        return None
    start, end = np.array(across[0]), np.array(across[1])
    length = float(np.linalg.norm(end - start))
    way = (end - start) / length
    turned = np.arctan(np.clip(slope, -SETTINGS.steepest, SETTINGS.steepest))
    way = np.cos(turned) * way - np.sin(turned) * np.array([-way[1], way[0]])
    axes = np.stack([way, [-way[1], way[0]]])
    width = float(np.sqrt(np.linalg.eigvalsh(blur.covariance)[-1]))
    reach = np.ceil(length / 2 + SETTINGS.beyond * width)
    places = np.arange(-reach, reach + 0.5)
    count = max(SETTINGS.shortest, 2 * round(SETTINGS.piece * width / 2) + 1)
    beside = np.arange(count) - (count - 1) / 2
    at = (start + end) / 2 + places[:, None, None] * axes[0] + beside[:, None] * axes[1]
    block = _read(sight, space, at)
    return None if block is None else LineProfiles(places, block, line_spread(blur, axes))


def _read(sight: Sight, space: BlurSpace, at: Array) -> Array | None:
    """[N, L, 3] of the photo at [N, L, 2] px; None where one is not on it, or counts for nothing."""
    camera, view = sight.camera, sight.view
    assert view is not None
    if not ((at > 1).all() and (at < [camera.width - 1, camera.height - 1]).all()):
        return None
    valid = view.valid
    if valid is not None and not valid[at[..., 1].astype(int), at[..., 0].astype(int)].all():
        return None
    low = np.maximum(np.floor(at.min(axis=(0, 1))).astype(int) - SETTINGS.margin, 0)
    high = np.ceil(at.max(axis=(0, 1))).astype(int) + SETTINGS.margin
    picture = view.planes()[:, low[1] : high[1], low[0] : high[0]].transpose(1, 2, 0).astype(np.float64)
    return Sampler.of(srgb_to_linear(picture) if space == "linear" else picture).at(at - low)
