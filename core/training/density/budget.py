"""How many Gaussians a set of photos can hold: no more than it has values to say what they are like.

Few small photos that a long run fits with many Gaussians are explained px by px, and views between them are not: what a
photo does not show, parameters without evidence are free to fill.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...constants import SH_COEFFICIENTS
from ...numbers import number
from ...photos.empty import empty_pixels
from ...views import View

#: Of a Gaussian besides its colour: place, size, direction, opacity.
_SHAPE = 3 + 3 + 4 + 1


@dataclass(frozen=True)
class BudgetSettings:
    """Numbers of the budget that photos set."""

    values_for_one: float = number(
        2.0,
        "values of px",
        "that photos must show for each parameter of a budget above `unquestioned`",
        "a first choice; that a limit is needed was seen on the rendered plant (42 photos of 400 x 300 px over white,"
        " degree 3, best): 139,000 Gaussians 26.64 dB on held-out views, 40,000 27.29",
    )
    ample: float = number(
        4.0,
        "values of px",
        "that photos must show for each parameter, for sharp ones to be fitted with more than a preset has",
        "held-out views, 49,000 -> 80,000 Gaussians, for whose parameters photos show so many values each: copr (8.3)"
        " +0.51 dB, lego (3.0) +0.55, banana (3.2) +0.18; brighton (2.9; three seeds) -0.15, -0.23, -0.19, the shelf"
        " (2.1) +0.04",
        "village balanced 33.81 -> 34.35 dB, room 28.15 -> 28.45, both with 64,000; with this rule lego has 60,000 and"
        " gains 0.20, brighton 57,000 and loses 0.12",
    )
    unquestioned: int = number(
        40_000,
        "count",
        "Gaussians that any photos may have: the balanced preset's budget, chosen before",
        "lego, 12 to 36 photos of 200 and 400 px, balanced and best: 20,000 lose 0.1 dB in the mean of eight runs ("
        "-0.33 to +0.10), 10,000 lose 0.6",
        "20,000 to 28,700 gain 0.07 to 0.25 dB on orrery, plant and orrery-front: the sets disagree, and it stays",
    )
    photos: int = number(12, "photos", "whose px are counted, evenly over the set; more say little new")


SETTINGS = BudgetSettings()


def supported_gaussians(
    views: Sequence[View], sh_degree: int, settings: BudgetSettings = SETTINGS, photos: int | None = None
) -> int:
    """How many Gaussians the photos can say something about.

    Args:
        views: photos to fit; what is masked or known to be empty says nothing.
        sh_degree: of the Gaussians' colours, 0 to 3.
        photos: how many there are, where `views` are only some of them.

    Returns:
        A count, at least `unquestioned`.
    """
    some = views[:: max(1, len(views) // settings.photos)]
    shown = float(np.mean([_shown(view) for view in some])) * (photos or len(views)) if some else 0.0
    each = _SHAPE + 3 * SH_COEFFICIENTS[sh_degree]
    return max(settings.unquestioned, int(3 * shown / (settings.values_for_one * each)))


def ample_gaussians(
    views: Sequence[View], sh_degree: int, settings: BudgetSettings = SETTINGS, photos: int | None = None
) -> int:
    """How many Gaussians the photos show amply; arguments as of `supported_gaussians`."""
    amply = replace(settings, values_for_one=settings.ample, unquestioned=0)
    return supported_gaussians(views, sh_degree, amply, photos)


def _shown(view: View) -> int:
    """Px of a photo that show something."""
    counts = np.ones(view.photo.shape[:2], bool) if view.mask is None else view.mask
    empty = empty_pixels(view)
    return int((counts if empty is None else counts & ~empty).sum())
