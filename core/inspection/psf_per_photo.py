"""Every photo's own Gaussian around the one that all share, for a medium that changes while photos are taken.

One photo shows its blur less surely than all together. How far the photos' own variances scatter beyond what their
uncertainty explains is how far the blurs differ (empirical Bayes): each photo's estimate is drawn towards the shared
one by the share that is its own noise, and where the scatter is no more than noise, all photos keep the shared one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from ..imaging.psf import PointSpread
from ..numbers import number
from ..photos.load import Photo
from .photo_set import SETTINGS as LOOKED_AT
from .photo_set import PhotoSet
from .spectra import Blur


@dataclass(frozen=True)
class OwnBlurSettings:
    """Numbers of each photo's own width."""

    scattered_share: float = number(
        0.5,
        "share",
        "of a fit's error that scatters from photo to photo: the rest is how the scene bends the law, which photos of "
        "one scene share",
        "synthetic and real sets whose photos are blurred alike",
    )
    significance: float = number(0.01, "probability", "blurs differ where chance would scatter as far less often")
    minimum_photos: int = number(5, "count", "whose scatter says something")
    narrowest: float = number(0.3, "px", "blur that a photo may be given")


SETTINGS = OwnBlurSettings()


@dataclass(frozen=True)
class OwnSpreads:
    """What was estimated.

    Attributes:
        spreads: by photo name, only photos whose blur is not the shared one.
        alone: sigma (px) by photo, from its own spectrum alone; shrunk: the same drawn towards the shared one.
        between: standard deviation (px^2) of the photos' variances, without what noise explains; 0 for equal blurs.
        text: one sentence.
    """

    spreads: Mapping[str, PointSpread]
    alone: Mapping[str, float]
    shrunk: Mapping[str, float]
    between: float
    text: str


def psf_per_photo(
    photos: Sequence[Photo], shared: PointSpread, linear: bool = False, paths: Mapping[str, float] | None = None
) -> OwnSpreads:
    """Each photo's own width of the shared Gaussian.

    Args:
        shared: a Gaussian, px of the photos as loaded.
        linear: read spectra on linear light instead of sRGB values.
        paths: lengths (px) of paths of motion that are simulated besides: their part of the blur is taken off.
    """
    seen_blurs = {name: blur for name, blur in _blurs(photos, linear).items() if blur is not None}
    variance = float(np.trace(shared.covariance)) / 2
    if len(seen_blurs) < SETTINGS.minimum_photos:
        return OwnSpreads(
            {}, {}, {}, 0.0, f"only {len(seen_blurs)} photos show a blur of their own: all get the shared one"
        )
    names = list(seen_blurs)
    motion = np.array([(paths or {}).get(name, 0.0) ** 2 / 24.0 for name in names])
    seen = np.array([seen_blurs[name].variance for name in names]) - motion
    off = seen - float(np.median(seen))
    noise = SETTINGS.scattered_share * np.array([seen_blurs[name].variance_error for name in names])
    alone = {name: math.sqrt(max(variance + o, SETTINGS.narrowest**2)) for name, o in zip(names, off, strict=True)}
    excess = float(np.square(off / noise).sum())
    if excess <= chdtri(len(names) - 1, SETTINGS.significance):
        text = "the photos' own blurs differ by no more than their uncertainty: all get the shared one"
        return OwnSpreads({}, alone, dict.fromkeys(alone, math.sqrt(variance)), 0.0, text)
    between = max(float(np.square(off).mean() - np.square(noise).mean()), 1e-6)
    kept = between / (between + noise**2)
    shrunk = {
        name: math.sqrt(max(variance + share * o, SETTINGS.narrowest**2))
        for name, share, o in zip(names, kept, off, strict=True)
    }
    spreads = {name: _scaled(shared, sigma / math.sqrt(variance)) for name, sigma in shrunk.items()}
    low, high = min(shrunk.values()), max(shrunk.values())
    text = f"{len(spreads)} photos have a Gaussian of their own, sigma {low:.2f} to {high:.2f} px"
    return OwnSpreads(spreads, alone, shrunk, math.sqrt(between), text)


def _blurs(photos: Sequence[Photo], linear: bool) -> dict[str, Blur | None]:
    """The blur of every photo, whatever its size."""
    found: dict[str, Blur | None] = {}
    for size in sorted({photo.size for photo in photos}):
        same = [photo for photo in photos if photo.size == size]
        for first in range(0, len(same), LOOKED_AT.most_photos):
            part = PhotoSet(same[first : first + LOOKED_AT.most_photos], linear=linear)
            found.update(zip((photo.name for photo in part.looked_at), part.blurs, strict=True))
    return found


def _scaled(psf: PointSpread, factor: float) -> PointSpread:
    x, y = psf.sigma_x * factor, psf.sigma_y * factor
    return replace(psf, sigma_x=x, sigma_y=y, source=gaussian_text(x, y, psf.angle), notes=())


def gaussian_text(sigma_x: float, sigma_y: float, angle: float) -> str:
    """As `parse_psf` reads it."""
    return f"gaussian:{sigma_x:.3f}" if sigma_x == sigma_y else f"gaussian:{sigma_x:.3f},{sigma_y:.3f},{angle:.1f}"
