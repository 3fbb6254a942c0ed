"""Surfaces that lie off every guess, sought over all depths where the band around the guesses held none.

Guesses lie between points, and on what is near, thin or plain there is often none: a table before a wall, a twig.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .. import compiled
from ..numbers import number
from .agreement import AgreementSettings, agreed
from .choice import ChoiceSettings, neighbours_of
from .hull import Hull
from .maps import wanted_pixels
from .stack import Floats, ViewStack
from .sweep import DepthMap, SweepSettings, swept

#: What the numbers below were chosen on, and checked on: docs/studies/points.md.
_CHOSEN = "a room and a shelf rendered by Cycles, cameras found: drafts"
_CHECKED = "a village blurred by 3 px; copr, banana and brighton blurred by 5 px: drafts"


@dataclass(frozen=True)
class MissedSettings:
    """Of the depths that are tried, and of what is believed."""

    nearest: float = number(
        0.3,
        "share",
        "of the nearest point's depth, where the planes begin: things stand before all points",
        f"{_CHOSEN}: 0.5 was 0.1 dB worse on the shelf",
        _CHECKED,
    )
    farthest: float = number(1.6, "share", "of the farthest point's depth, where they end", "as at given cameras")
    planes: int = number(64, "count", "inverse depths, evenly spaced between them", _CHOSEN, _CHECKED)
    neighbours: int = number(3, "views", "that each is compared with; the better half decides", _CHOSEN, _CHECKED)
    witnesses: int = number(
        2,
        "views",
        "that must see the same surface: without a guess more is mistaken",
        f"{_CHOSEN}: with one 0.3 dB less in the room, 0.1 on the shelf",
        _CHECKED,
    )
    stray: float = number(2.0, "percent", "of the points at each end that are neither nearest nor farthest")


SETTINGS = MissedSettings()


def with_missed(
    checked: Sequence[DepthMap],
    positions: Floats,
    views: ViewStack,
    hull: Hull | None,
    settings: MissedSettings = SETTINGS,
) -> list[DepthMap]:
    """The maps, and in their empty px what a sweep over all depths finds and other maps confirm.

    Args:
        checked: what the band held; positions: [N, 3] world, the cameras' points; each of the views sees some.
    """
    with ThreadPoolExecutor(compiled.threads()) as pool:
        fuller = list(pool.map(lambda one: _filled(one, positions, views, hull, settings), checked))
    confirmed = agreed(fuller, views, AgreementSettings(witnesses=settings.witnesses))
    return [_under(one, more) for one, more in zip(checked, confirmed, strict=True)]


def _filled(
    one: DepthMap, positions: Floats, views: ViewStack, hull: Hull | None, settings: MissedSettings
) -> DepthMap:
    """A map, and what a sweep finds in its empty px, unconfirmed."""
    depth = views.depths(one.view, positions)[1]
    near, far = np.percentile(depth, [settings.stray, 100.0 - settings.stray])
    bounds = settings.nearest * float(near), settings.farthest * float(far)
    others = neighbours_of(one.view, views, *bounds, ChoiceSettings(neighbours=settings.neighbours))
    empty = wanted_pixels(views, one.view) & (one.depth == 0)
    return _under(one, swept(one.view, views, others, bounds, empty, hull, SweepSettings(planes=settings.planes)))


def _under(above: DepthMap, below: DepthMap) -> DepthMap:
    """What the first has, and where it has nothing what the second has."""
    there = above.depth > 0
    depth, confidence = (
        np.where(there, *both) for both in ((above.depth, below.depth), (above.confidence, below.confidence))
    )
    return DepthMap(above.view, depth, confidence)
