"""The blur that edges all over a set of photos share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numbers import number
from .edges import CALIBRATION, CHECKED, Edges, find_edges, together
from .edges import SETTINGS as EDGES
from .lower_mode import LowerMode, find_lower_mode
from .photo_set import PhotoSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EdgeBlurSettings:
    """Numbers of the search for the mode of edge widths."""

    first_photos: int = number(8, "count", "photos that are looked at first")
    more_photos: int = number(4, "count", "how many more at a time")
    enough_edges: int = number(200, "count", "edges after which no more photos are looked at: time only")
    hopeless_edges: int = number(6, "count", "so few that more photos will not show any")
    budget: int = number(3000, "edges", "fitted in all of the first photos together: half a second")
    guesses: tuple[float, ...] = number(
        (1.7, 2.9, 5.0, 8.5, 0.6),
        "ratio",
        "multiples of a guess that shows no mode, tried on a few photos: where most of a photo is flat or dark, its "
        "spectrum gives a fraction of the blur",
    )
    guess_photos: int = number(4, "count", "photos on which those guesses are tried")
    widest_guess: float = number(10.0, "px", "up to which such guesses go")
    minimum_gain: float = number(
        3.0, "log likelihood", "over a broad hump, from which a mode is no chance find", CALIBRATION, CHECKED
    )
    narrowest_guess: float = number(0.7, "px", "least width of the pieces: pixels blur, too")
    settled: float = number(0.1, "ratio", "relative change of the width below which pieces had the right size")


SETTINGS = EdgeBlurSettings()


def edge_blur(photos: PhotoSet, guess: Array) -> LowerMode | None:
    """The mode of the edge widths of `looked_at`, near the covariance `guess` [3], px^2; None with too few edges."""
    found = _settled(photos, guess, len(photos.greys))
    if found is not None and found.gain >= SETTINGS.minimum_gain:
        return found
    for factor in SETTINGS.guesses:
        if factor * math.sqrt(float(guess[:2].mean())) > SETTINGS.widest_guess:
            continue
        few = _settled(photos, guess * factor**2, SETTINGS.guess_photos)
        if few is not None and few.gain >= SETTINGS.minimum_gain and few.gain > (0.0 if found is None else found.gain):
            whole = _settled(photos, few.covariance, len(photos.greys))
            found = whole if whole is not None else few
    return found


def _settled(photos: PhotoSet, guess: Array, most: int) -> LowerMode | None:
    """The mode, with pieces of its own size."""
    found = None
    for _ in range(3):
        sigma = max(math.sqrt(float(guess[:2].mean())), SETTINGS.narrowest_guess)
        mode = find_lower_mode(edges_as_wide(photos, sigma, most), guess * sigma**2 / float(guess[:2].mean()))
        if mode is None:
            break
        found = mode
        if mode.gain < 0:
            break
        width = math.sqrt(mode.variance)
        if abs(width / sigma - 1) < SETTINGS.settled:
            break
        guess = mode.covariance
    return found


def edges_as_wide(photos: PhotoSet, sigma: float, looked: int) -> Edges:
    """Edges about `sigma` px wide of evenly spread photos, `looked` of `looked_at` at most, until there are enough."""
    count = min(looked, len(photos.greys))
    order = np.linspace(0, len(photos.greys) - 1, count).round().astype(int)
    step = max(1, count // SETTINGS.first_photos)
    order = np.concatenate([order[k::step] for k in range(step)])  # the first ones are spread over all, too
    most = min(EDGES.maximum_edges, SETTINGS.budget // min(len(photos.greys), SETTINGS.first_photos))
    found: list[Edges] = []
    for turn, index in enumerate(order):
        if (
            turn >= SETTINGS.first_photos
            and (turn - SETTINGS.first_photos) % SETTINGS.more_photos == 0
            and not SETTINGS.hopeless_edges <= sum(len(e) for e in found) < SETTINGS.enough_edges
        ):
            break
        grey, noise, clipped = photos.greys[index], photos.grey_noise[index], photos.clipped[index]
        found.append(find_edges(grey, noise, sigma, clipped, int(index), most))
    return together(found)
