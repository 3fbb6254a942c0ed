"""Far surroundings: px whose depth nothing shows, such as sky, begin beyond everything that was found.

Left empty, they would be explained by what is near: fog that grows out of the nearest surfaces. A sphere beyond all of
them moves in photos as little as the sky does, and a sample for each px of a small view has the spacing that its
perspective asks for. Only px count that other views confirm: there, too, the far place shows no known surface, and the
same colour. (A plain wall or field at no known depth is elsewhere in the next photo.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from ..numbers import number
from .stack import Floats, ViewStack
from .sweep import DepthMap
from .union import Samples, joined

#: What the numbers below were thought of on.
_THOUGHT_OF = "thought of; no other value was tried"


@dataclass(frozen=True)
class FarSettings:
    """Of what lies beyond."""

    step: int = number(2, "px of a small view", "between px that are placed: far things are smooth", _THOUGHT_OF)
    beyond: float = number(2.0, "factor", "on the distance of the farthest surfaces, where the far begins", _THOUGHT_OF)
    still: float = number(
        10.0,
        "spreads of the cameras",
        "at least: from there on little moves in photos",
        "a village from all round (drafts, held-out views): 10 +0.21 dB against nothing far, 100 -0.94, as what is far"
        " there are fields and trees rather than sky; balanced, 10: +0.06",
        "drafts: room +0.14 dB, village from above -0.10",
    )
    alike: float = number(
        0.06,
        "share of white",
        "difference of two photos' colours, in the worst channel, up to which they agree",
        _THOUGHT_OF,
    )
    near: int = number(
        3, "px", "window around a px in which no depth may be known: guesses leave every second px out", _THOUGHT_OF
    )
    stray: float = number(2.0, "percent", "of the surfaces that do not count as the farthest", _THOUGHT_OF)


SETTINGS = FarSettings()


@dataclass(frozen=True)
class OpenView:
    """A view (its index) and its px that show something at no known depth, `open` [H, W]."""

    view: int
    open: NDArray[np.bool_]


def open_views(
    trusted: Sequence[DepthMap], guessed: Sequence[DepthMap], wanted: Sequence[NDArray[np.bool_]]
) -> list[OpenView]:
    """Px that show something (`wanted`) where neither a trusted nor a guessed depth is near."""
    found = []
    for sure, guess, want in zip(trusted, guessed, wanted, strict=True):
        known = maximum_filter(np.maximum(sure.depth, guess.depth), size=SETTINGS.near)
        found.append(OpenView(sure.view, want & (known == 0)))
    return found


def far_samples(
    opened: Sequence[OpenView], surfaces: Floats, views: ViewStack, confidence: float, settings: FarSettings = SETTINGS
) -> Samples:
    """Samples on a sphere around the cameras, behind px that show something at no known depth.

    Args:
        opened: views with the px behind which something far may be.
        surfaces: [N, 3] points on the surfaces that were found.
        confidence: of the samples.
    """
    middle = np.median(views.centres, axis=0)
    spread = float(np.linalg.norm(views.centres - middle, axis=1).max())
    reach = float(np.percentile(np.linalg.norm(surfaces - middle, axis=1), 100.0 - settings.stray))
    radius = max(settings.beyond * reach, settings.still * spread)
    parts = []
    for one in opened:
        rows, columns = settings.step * np.array(np.nonzero(one.open[:: settings.step, :: settings.step]))
        rays = views.lifted(one.view, np.stack([columns, rows], axis=1) + 0.5, np.ones(len(rows)))
        rays = rays - views.centres[one.view]
        depth = _to_sphere(views.centres[one.view] - middle, rays, radius)
        positions = views.centres[one.view] + rays * depth[:, None]
        colours = views.colours[one.view][rows, columns]
        sure = np.full(len(rows), confidence, np.float32)
        samples = Samples(positions, colours, sure, settings.step * depth / views.focals[one.view])
        parts.append(samples.chosen(_confirmed(samples, one.view, opened, views, settings)))
    return joined(parts)


def _confirmed(
    samples: Samples, own: int, opened: Sequence[OpenView], views: ViewStack, settings: FarSettings
) -> NDArray[np.bool_]:
    """[N] whether more of the other views agree with far samples than contradict them, and one at least does."""
    votes = np.zeros(len(samples), np.int64)
    for one in opened:
        if one.view == own:
            continue
        columns, rows, inside = _pixels(views, one.view, samples.positions)
        shown = views.colours[one.view][rows, columns].astype(np.int64)
        same = np.abs(shown - samples.colours).max(axis=1) <= 255 * settings.alike
        votes += inside * np.where(same & one.open[rows, columns], 1, -1)
    return votes > 0


def _pixels(
    views: ViewStack, view: int, positions: Floats
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """[N] columns and rows of the px that show points [N, 3], and whether they are inside the frame (0 where not)."""
    p = positions @ views.projections[view].T + views.offsets[view]
    depth = np.where(p[:, 2] > 0, p[:, 2], 1.0)
    at = np.floor(p[:, :2] / depth[:, None])
    inside = (p[:, 2] > 0) & ((at >= 0) & (at < views.sizes[view])).all(axis=1)
    columns, rows = np.where(inside[:, None], at, 0).astype(np.int64).T
    return columns, rows, inside


def _to_sphere(start: Floats, rays: Floats, radius: float) -> Floats:
    """[K] how often rays [K, 3] from a point [3] inside a sphere about 0 are taken until they meet it."""
    a = (rays**2).sum(axis=1)
    b = rays @ start
    c = float(start @ start) - radius**2
    return np.asarray((np.sqrt(b**2 - a * c) - b) / a)
