"""The point spread from the very photos it blurred: how far they tell it, and plainly where they do not.

The loss of a training does not tell it: a smaller blur is always allowed, the scene then just stays softer. What
tells it is a prior on scenes: power falls as a power of frequency (`spectra`), which a Gaussian blur bends. So the
answer is as good as that law: a few per cent on scenes with edges and texture, an upper bound on soft ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import PsfError
from ..imaging.psf import PointSpread
from .effects.defocus import inspect as inspect_defocus
from .effects.motion import motion_of
from .photo_set import PhotoSet
from .spectra import Blur

#: Variance (px^2) that sharp photos of good cameras have of their own (lens, demosaicking), and its spread.
OWN, OWN_SPREAD = 0.2, 0.15
#: How far scenes' spectra bend from the law: share of the standard deviation (rms over four sets and 13 pictures).
LAW = 0.05
#: The lowest frequency used, times sigma: the law bends at a scene's largest scales.
LOWEST = 0.08
#: A scene whose power falls faster has no sharp edges: what looks like blur may be its own.
STEEPEST = 3.4
#: Largest relative error of an estimate that still is one; below `LEAST` px there is nothing to undo.
LOOSEST, LEAST = 0.15, 0.8
#: Motion or defocus of single photos makes the common blur uncertain; above this share of its variance, unknown.
SLIGHT = 0.2
#: Tiles must be this many standard deviations wide.
TILE_SIGMAS = 20.0


@dataclass(frozen=True)
class BlindPsf:
    """What the photos say about their blur; px.

    Attributes:
        sigma, error: geometric mean of both widths, and one standard deviation; NaN where nothing is known.
        low, high: 95 % interval; where only a bound is known, low is 0.
        sigma_x, sigma_y, angle: the Gaussian's axes (degrees from x towards y).
        verdict: 'estimated', 'sharp' (nothing to undo), 'upper bound' or 'not identifiable'.
        text: one sentence.
    """

    sigma: float
    error: float
    low: float
    high: float
    sigma_x: float
    sigma_y: float
    angle: float
    verdict: str
    text: str

    def point_spread(self) -> PointSpread | None:
        """The Gaussian, or None for sharp photos.

        Raises:
            PsfError: the photos do not tell.
        """
        if self.verdict == "sharp":
            return None
        if self.verdict != "estimated":
            raise PsfError(
                f"--psf auto: {self.text}",
                "Photograph a point of light or a slanted edge through the medium and give its kernel (measure-psf),"
                " or give --psf gaussian:SIGMA",
            )
        near_round = self.sigma_x < 1.08 * self.sigma_y
        widths = (self.sigma, self.sigma, 0.0) if near_round else (self.sigma_x, self.sigma_y, self.angle)
        source = f"gaussian:{widths[0]:.3f}" if near_round else "gaussian:" + ",".join(f"{v:.3f}" for v in widths)
        return PointSpread(sigma_x=widths[0], sigma_y=widths[1], angle=widths[2], source=source, notes=(self.text,))


def blind_psf(photos: PhotoSet) -> BlindPsf:
    """Estimates the blur that all photos share; see the module."""
    known = [blur for blur in photos.blurs if blur is not None]
    if len(known) < max(1, len(photos.looked_at) // 2):
        return _nothing("too little detail stands clear of the noise in these photos: not identifiable from them")
    total = np.median(np.stack([blur.covariance for blur in known]), axis=0)
    variance, error = _variance(photos, known)
    total = total * variance / max(float(total[:2].mean()), 1e-6)
    sigma = math.sqrt(max(variance - OWN, 0.0))
    if sigma > 0:
        error = math.hypot(error / (2 * sigma), LAW * sigma, OWN_SPREAD / (2 * max(sigma, 0.4)))
    slope = float(np.median([blur.slope for blur in known]))
    largest = math.sqrt(max(variance, 0.0)) + 1.96 * error
    if sigma < LEAST:
        return BlindPsf(sigma, error, 0.0, largest, sigma, sigma, 0.0, "sharp",
                        f"no blur beyond what sharp photos have: at most {largest:.2f} px")  # fmt: skip
    sx, sy, angle = _axes(total, variance - OWN)
    if slope > STEEPEST:
        text = f"this scene has no sharp edges (power falls as f^-{slope:.1f}): its blur is at most {largest:.2f} px"
        return BlindPsf(sigma, error, 0.0, largest, sx, sy, angle, "upper bound", text)
    own = _own_variance(photos)
    if own > SLIGHT * sigma**2:
        text = f"blur differs from photo to photo or with depth; at most {largest:.2f} px are common to all"
        return BlindPsf(sigma, error, 0.0, largest, sx, sy, angle, "upper bound", text)
    error = math.hypot(error, own / (2 * sigma))
    low, high = max(0.0, sigma - 1.96 * error), sigma + 1.96 * error
    text = f"estimated from the photos' spectra: sigma {sigma:.2f} px, 95 % interval {low:.2f} to {high:.2f}"
    found = BlindPsf(sigma, error, low, high, sx, sy, angle, "estimated", text)
    if error > LOOSEST * sigma:
        return _nothing(f"the photos allow any blur from {found.low:.1f} to {found.high:.1f} px: not identifiable")
    return found


def _own_variance(photos: PhotoSet) -> float:
    """Variance (px^2) that single photos or depths have beyond what is common to all; 0 where none is clear."""
    moved, defocus = motion_of(photos), inspect_defocus(photos)
    path = moved.length**2 / 24.0 if moved is not None and moved.significant else 0.0  # L^2 / 12 along one of two axes
    circle = float(defocus.estimate.get("value") or 0.0) ** 2 if defocus.needed else 0.0
    return max(path, circle)


def _variance(photos: PhotoSet, known: list[Blur]) -> tuple[float, float]:
    """Median variance and its standard error: of tiles where they are wide enough for the blur, else of the photos.

    Over a whole photo the scene's law bends at its largest scales; a tile does not see those.
    """
    whole = np.array([blur.variance for blur in known])
    lowest = LOWEST / math.sqrt(max(float(np.median(whole)), 0.1))
    values = np.array([blur.variance for blur in photos.blurs_between(lowest, 0.5) if blur is not None])
    values = values if len(values) else whole
    tiles = photos.tiles
    side = _side(photos)
    if len(tiles.variance) >= 20 and side > TILE_SIGMAS * math.sqrt(max(float(np.median(whole)), 0.1)):
        values = np.array([np.median(tiles.variance[tiles.photo == p]) for p in np.unique(tiles.photo)])
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(values - middle)))
    return middle, max(1.25 * scatter / math.sqrt(len(values)), 0.01 * abs(middle))


def _side(photos: PhotoSet) -> float:
    """Side of the tiles, px."""
    from .photo_set import LARGEST_TILE, SMALLEST_TILE, TILES

    return float(np.clip(min(photos.greys[0].shape) / TILES, SMALLEST_TILE, LARGEST_TILE))


def _axes(covariance: np.ndarray, mean: float) -> tuple[float, float, float]:
    xx, yy, xy = covariance
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    own = float(values.mean()) - mean
    small, large = (math.sqrt(max(v - own, 0.01)) for v in values)
    return large, small, math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0


def _nothing(text: str) -> BlindPsf:
    nan = float("nan")
    return BlindPsf(nan, nan, 0.0, float("inf"), nan, nan, 0.0, "not identifiable", text)
