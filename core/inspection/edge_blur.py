"""The blur that edges all over a set of photos share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .edges import MOST, Edges, find_edges, together
from .lower_mode import Pile, find_pile
from .photo_set import PhotoSet

Array = NDArray[np.float64]

#: Photos that are looked at first, how many more at a time, how many edges are enough, and so few that more photos
#: will not show any.
FIRST, MORE, ENOUGH, HOPELESS = 8, 4, 200, 6
#: Edges that are fitted in all of the first photos together: half a second.
BUDGET = 3000
#: Where a guess shows no pile, multiples of it, up to a width in px, are tried on a few photos: where most of a photo
#: is flat or dark, its spectrum tells a fraction of the blur.
LADDER, FEW, WIDEST = (1.7, 2.9, 5.0, 8.5, 0.6), 4, 10.0
#: A pile that is no chance find: log likelihood over a broad hump.
CLEAR = 3.0
#: Narrowest guess (px), and relative change of the width below which pieces of the right size were looked at.
NARROWEST, SETTLED = 0.7, 0.1


def edge_blur(photos: PhotoSet, guess: Array) -> Pile | None:
    """The pile of edge widths of `looked_at`, near the covariance `guess` [3], px^2; None with too few edges."""
    found = _settled(photos, guess, len(photos.greys))
    if found is not None and found.gain >= CLEAR:
        return found
    for factor in LADDER:
        if factor * math.sqrt(float(guess[:2].mean())) > WIDEST:
            continue
        few = _settled(photos, guess * factor**2, FEW)
        if few is not None and few.gain >= CLEAR and few.gain > (0.0 if found is None else found.gain):
            whole = _settled(photos, few.covariance, len(photos.greys))
            found = whole if whole is not None else few
    return found


def _settled(photos: PhotoSet, guess: Array, most: int) -> Pile | None:
    """The pile, with pieces of its own size."""
    found = None
    for _ in range(3):
        sigma = max(math.sqrt(float(guess[:2].mean())), NARROWEST)
        pile = find_pile(_edges(photos, sigma, most), guess * sigma**2 / float(guess[:2].mean()))
        if pile is None:
            break
        found = pile
        if pile.gain < 0:
            break
        width = math.sqrt(pile.variance)
        if abs(width / sigma - 1) < SETTLED:
            break
        guess = pile.covariance
    return found


def _edges(photos: PhotoSet, sigma: float, looked: int) -> Edges:
    """Edges of evenly spread photos, until there are enough."""
    count = min(looked, len(photos.greys))
    order = np.linspace(0, len(photos.greys) - 1, count).round().astype(int)
    step = max(1, count // FIRST)
    order = np.concatenate([order[k::step] for k in range(step)])  # the first ones are spread over all, too
    most = min(MOST, BUDGET // min(len(photos.greys), FIRST))
    found: list[Edges] = []
    for turn, index in enumerate(order):
        if turn >= FIRST and (turn - FIRST) % MORE == 0 and not HOPELESS <= sum(len(e) for e in found) < ENOUGH:
            break
        grey, noise, clipped = photos.greys[index], photos.grey_noise[index], photos.clipped[index]
        found.append(find_edges(grey, noise, sigma, clipped, int(index), most))
    return together(found)
