"""The point spread from the very photos it blurred: how far they determine it, and plainly where they do not.

The loss of a training does not determine it: a smaller blur is always allowed, the scene then just stays softer. Two
priors on scenes do. Sharp edges: each becomes the blur's own profile, and the widths of many edges have their lower
mode at its width (`edge_blur`). Spectra: power falls as a power of frequency (`spectra`), which a Gaussian blur bends.
Scenes that show no sharp edges may be soft themselves: of those only an upper bound is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import PsfError
from ..imaging.psf import PointSpread
from ..numbers import number
from .edge_blur import SETTINGS as EDGE_BLUR
from .edge_blur import edge_blur
from .edges import CALIBRATION, CHECKED
from .evidence import shortened
from .lower_mode import LowerMode
from .photo_set import PhotoSet
from .spectra import Blur


@dataclass(frozen=True)
class BlindPsfSettings:
    """Rules by which edges and spectra together become an estimate, a bound, or nothing."""

    own_variance: float = number(
        0.15, "px^2", "that sharp photos of good cameras have (pixel, lens, demosaicking)", CALIBRATION, CHECKED
    )
    own_spread: float = number(
        0.15, "px^2", "of own_variance over cameras", CALIBRATION + "; widened after a look at the others", CHECKED
    )
    law_bend: float = number(
        0.05,
        "share of the standard deviation",
        "how far scenes' spectra bend from the law",
        "rms over four sets and 13 pictures, those of benchmarks.blind_psf among them",
    )
    law_bend_soft: float = number(
        0.1, "share of the standard deviation", "the same without sharp edges, for the bound", CALIBRATION, CHECKED
    )
    lowest_frequency: float = number(
        0.08, "cycles/px times sigma", "lowest used: the law bends at a scene's largest scales", CALIBRATION, CHECKED
    )
    step_error: float = number(
        0.02,
        "share of the standard deviation",
        "error of a mode of steps that more edges do not lessen (neighbours, curvature)",
        CALIBRATION,
        CHECKED,
    )
    unclear_error: float = number(
        0.03, "share of the standard deviation", "the same of a mode not clear by every edge", CALIBRATION, CHECKED
    )
    gain_per_edge: float = number(
        0.2,
        "log likelihood over a broad hump",
        "from which each edge by itself makes a mode clear: many photos of soft things make a hump clear by number",
        CALIBRATION + "; copr with all its photos, estimated 30 % too wide, brought the rule",
        CHECKED,
    )
    minimum_edges: int = number(15, "count", "in a mode", CALIBRATION, CHECKED)
    certain_gain: float = number(
        10.0,
        "log likelihood over a broad hump",
        "from which a mode that is clear by every edge needs no spectrum beside it",
        CALIBRATION,
        CHECKED,
    )
    maximum_disagreement: float = number(
        0.065, "log width", "of spectrum and edges, where a mode needs the spectrum", CALIBRATION, CHECKED
    )
    maximum_doubt: float = number(
        2.5,
        "ratio",
        "where edges and spectra disagree by more than their errors the error grows with it, up to so many times",
        CALIBRATION,
        CHECKED,
    )
    maximum_error: float = number(0.15, "share", "largest relative error of an estimate", CALIBRATION, CHECKED)
    smallest_sigma: float = number(0.8, "px", "below it there is nothing to undo", CALIBRATION, CHECKED)
    maximum_own_share: float = number(
        0.2, "share", "of the common variance: motion or defocus of single photos beyond it allows a bound only"
    )
    minimum_tile: float = number(20.0, "sigma", "width of tiles whose spectra are read", CALIBRATION, CHECKED)
    steepest_slope: float = number(
        3.4, "exponent", "a scene whose power falls faster is soft itself: no guess", CALIBRATION, CHECKED
    )


SETTINGS = BlindPsfSettings()


@dataclass(frozen=True)
class BlindPsf:
    """What the photos say about their blur; px.

    Attributes:
        sigma, error: geometric mean of both widths, and one standard deviation; NaN where nothing is estimated.
        low, high: 95 % interval; where only a bound is estimated, low is 0.
        sigma_x, sigma_y, angle: the Gaussian's axes (degrees from x towards y).
        verdict: 'estimated', 'sharp' (nothing to undo), 'upper bound' or 'not identifiable'.
        text: one sentence.
        guess: of an upper bound, whether spectra alone may be followed: the scene's power falls as scenes' usually do.
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
    guess: bool = False

    def point_spread(self) -> PointSpread | None:
        """The Gaussian, or None for sharp photos.

        Where there is only a bound, a guess on the safe side is taken and called one: too narrow a blur leaves the
        twin softer than it could be, too wide a one invents detail.

        Raises:
            PsfError: the photos do not determine it.
        """
        if self.verdict == "sharp":
            return None
        safe = 1.0
        text = self.text
        if self.verdict == "upper bound":
            safe = max(self.sigma - self.error, 0.0) / self.sigma
            text = (
                f"only guessed: {self.text}. Taken are {safe * self.sigma:.2f} px; photograph a point of light or a "
                "slanted edge through the medium (measure-psf) to be sure"
            )
        if self.verdict != "estimated" and not (self.guess and safe * self.sigma >= SETTINGS.smallest_sigma):
            raise PsfError(
                f"--psf auto: {self.text}",
                "Photograph a point of light or a slanted edge through the medium and give its kernel (measure-psf),"
                " or give --psf gaussian:SIGMA",
            )
        sx, sy, sigma = (safe * value for value in (self.sigma_x, self.sigma_y, self.sigma))
        near_round = sx < 1.08 * sy
        widths = (sigma, sigma, 0.0) if near_round else (sx, sy, self.angle)
        source = f"gaussian:{widths[0]:.3f}" if near_round else "gaussian:" + ",".join(f"{v:.3f}" for v in widths)
        return PointSpread(sigma_x=widths[0], sigma_y=widths[1], angle=widths[2], source=source, notes=(text,))


def blind_psf(photos: PhotoSet) -> BlindPsf:
    """Estimates the blur that all photos share; see the module."""
    spectrum = _spectrum(photos)
    edges = _edges(photos, spectrum)
    found = _together(spectrum, edges)
    if found is None:
        if spectrum is None:
            return _nothing("too little detail stands clear of the noise in these photos: not identifiable from them")
        return _bound(spectrum, edges, photos)
    total, error = found
    variance = float(total[:2].mean())
    sigma = math.sqrt(max(variance - SETTINGS.own_variance, 0.0))
    if sigma < SETTINGS.smallest_sigma:
        return _sharp(sigma, error, math.sqrt(variance) + 1.96 * error)
    sx, sy, angle = _axes(total, variance - SETTINGS.own_variance)
    own = _own_variance(photos)
    if own > SETTINGS.maximum_own_share * sigma**2:
        largest = math.sqrt(variance) + 1.96 * error
        text = f"blur differs from photo to photo or with depth; at most {largest:.2f} px are common to all"
        return BlindPsf(sigma, error, 0.0, largest, sx, sy, angle, "upper bound", text)
    error = math.hypot(error, own / (2 * sigma))
    low, high = max(0.0, sigma - 1.96 * error), sigma + 1.96 * error
    if error > SETTINGS.maximum_error * sigma:
        return _nothing(f"the photos allow any blur from {low:.1f} to {high:.1f} px: not identifiable")
    text = f"estimated from the photos' edges and spectra: sigma {sigma:.2f} px, 95 % interval {low:.2f} to {high:.2f}"
    return BlindPsf(sigma, error, low, high, sx, sy, angle, "estimated", text)


def edges_of(photos: PhotoSet) -> LowerMode | None:
    """The lower mode of the photos' edges, wherever it is; `shared_width` says what it is worth."""
    return _edges(photos, _spectrum(photos))


def _edges(photos: PhotoSet, spectrum: _Spectrum | None) -> LowerMode | None:
    return edge_blur(photos, np.array([4.0, 4.0, 0.0]) if spectrum is None else spectrum.covariance)


@dataclass(frozen=True)
class _Spectrum:
    """Total covariance [3] (px^2) by the law, the error of its root (px) by chance, and the scene's exponent."""

    covariance: np.ndarray
    error: float
    slope: float

    @property
    def width(self) -> float:
        """Standard deviation, root of the mean over both axes, px."""
        return math.sqrt(float(self.covariance[:2].mean()))


def _spectrum(photos: PhotoSet) -> _Spectrum | None:
    """What the spectra say; None where too few photos have enough detail."""
    measured = [blur for blur in photos.blurs if blur is not None]
    if len(measured) < max(1, len(photos.looked_at) // 2):
        return None
    shape = np.median(np.stack([blur.covariance for blur in measured]), axis=0)
    variance, error = _variance(photos, measured)
    variance = max(variance, 0.01)
    mean = float(shape[:2].mean())
    shape = shape / mean if mean > 0.05 and np.linalg.det(_matrix(shape)) > 0.1 * mean**2 else np.array([1.0, 1.0, 0.0])
    slope = float(np.median([blur.slope for blur in measured]))
    return _Spectrum(shape * variance, error / (2 * math.sqrt(max(variance, SETTINGS.own_variance))), slope)


def _together(spectrum: _Spectrum | None, edges: LowerMode | None) -> tuple[np.ndarray, float] | None:
    """Total covariance [3] and the error of the blur's width, px; None where no sharp edges are seen."""
    if edges is None or edges.gain < EDGE_BLUR.minimum_gain or edges.number < SETTINGS.minimum_edges:
        return None
    width = math.sqrt(edges.variance)
    steps = edges.gain >= SETTINGS.gain_per_edge * edges.number
    error = math.hypot(edges.error, SETTINGS.step_error if steps else SETTINGS.unclear_error)
    logarithm, total = math.log(width), edges.covariance
    apart = math.log(spectrum.width) - logarithm if spectrum is not None else math.inf
    if not (steps and edges.gain >= SETTINGS.certain_gain) and abs(apart) > SETTINGS.maximum_disagreement:
        return None
    if spectrum is not None:
        other = math.hypot(spectrum.error / spectrum.width, SETTINGS.law_bend)
        doubt = abs(apart) / math.hypot(error, other)
        share = (
            error**2 / (error**2 + other**2) if doubt < SETTINGS.maximum_doubt else 0.0
        )  # spectra fail by far, edges do not
        logarithm += share * apart
        total = total * math.exp(2 * share * apart)
        error = error * math.sqrt(1 - share) * min(max(1.0, doubt), SETTINGS.maximum_doubt)
    width = math.exp(logarithm)
    sigma = math.sqrt(max(width**2 - SETTINGS.own_variance, 0.16))
    return total, math.hypot(error * width**2 / sigma, SETTINGS.own_spread / (2 * sigma))


def _bound(spectrum: _Spectrum, edges: LowerMode | None, photos: PhotoSet) -> BlindPsf:
    """What is reported without sharp edges."""
    width = spectrum.width
    sigma = math.sqrt(max(width**2 - SETTINGS.own_variance, 0.0))
    error = math.hypot(spectrum.error, SETTINGS.law_bend_soft * width, SETTINGS.own_spread / (2 * max(sigma, 0.4)))
    largest = width + 1.96 * error
    if edges is not None and edges.number >= SETTINGS.minimum_edges:
        # No edge is narrower than the blur but by chance.
        largest = max(largest, math.sqrt(edges.variance) * (1 + 1.96 * math.hypot(edges.error, SETTINGS.step_error)))
    if sigma < SETTINGS.smallest_sigma:
        return _by_edges_alone(edges) or _sharp(sigma, error, largest)
    sx, sy, angle = _axes(spectrum.covariance, sigma**2)
    text = (
        f"no sharp edges stand out, so the scene may be soft itself: at most {largest:.2f} px of blur"
        f" (its spectra alone would say {sigma:.2f})"
    )
    return BlindPsf(
        sigma, error, 0.0, largest, sx, sy, angle, "upper bound", text, spectrum.slope <= SETTINGS.steepest_slope
    )


def shared_width(edges: LowerMode | None) -> tuple[float, float] | None:
    """px, standard deviation of the blur that edges clearly share, and its error; None where there is none to undo."""
    if edges is None or edges.number < SETTINGS.minimum_edges or edges.gain < SETTINGS.certain_gain:
        return None
    sigma = math.sqrt(max(edges.variance - SETTINGS.own_variance, 0.0))
    error = math.hypot(edges.error, SETTINGS.unclear_error) * sigma
    error = math.hypot(error, SETTINGS.own_spread / (2 * max(sigma, 0.4)))
    return (sigma, error) if sigma - error >= SETTINGS.smallest_sigma else None


def _by_edges_alone(edges: LowerMode | None) -> BlindPsf | None:
    """What clear edges say where spectra would call the photos sharp; None where they do not contradict.

    Blur that grows with the depth, as frosted glass makes it, hardly bends the law of spectra, or too steeply to tell
    it from the scene. But no edge is narrower than the blur.
    """
    found = shared_width(edges)
    if edges is None or found is None:
        return None
    sigma, error = found
    largest = sigma + 1.96 * error
    text = (
        f"spectra show no blur, but hardly an edge is narrower than {sigma:.2f} px: at most {largest:.2f} px that all "
        "share"
    )
    return BlindPsf(sigma, error, 0.0, largest, *_axes(edges.covariance, sigma**2), "upper bound", text, guess=True)


def _sharp(sigma: float, error: float, largest: float) -> BlindPsf:
    text = f"no blur beyond what sharp photos have: at most {largest:.2f} px"
    return BlindPsf(sigma, error, 0.0, largest, sigma, sigma, 0.0, "sharp", text)


def _own_variance(photos: PhotoSet) -> float:
    """Variance (px^2) that single photos or depths have beyond what is common to all; 0 where none is clear."""
    moved, local = photos.motion, photos.local_blur if photos.observations is not None else None
    path = moved.length**2 / 24.0 if moved is not None and moved.significant else 0.0  # L^2 / 12 along one of two axes
    defocus = local.defocus if local is not None and local.defocus_significant else 0.0
    return max(path, shortened(defocus) ** 2)


def _variance(photos: PhotoSet, measured: list[Blur]) -> tuple[float, float]:
    """Median variance and its standard error: of tiles where they are wide enough for the blur, else of the photos.

    Over a whole photo the scene's law bends at its largest scales; a tile does not see those.
    """
    whole = np.array([blur.variance for blur in measured])
    lowest = SETTINGS.lowest_frequency / math.sqrt(max(float(np.median(whole)), 0.1))
    values = np.array([blur.variance for blur in photos.blurs_between(lowest, 0.5) if blur is not None])
    values = values if len(values) else whole
    tiles = photos.tiles
    side = photos.tile_side
    if len(tiles.variance) >= 20 and side > SETTINGS.minimum_tile * math.sqrt(max(float(np.median(whole)), 0.1)):
        values = np.array([np.median(tiles.variance[tiles.photo == p]) for p in np.unique(tiles.photo)])
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(values - middle)))
    return middle, max(1.25 * scatter / math.sqrt(len(values)), 0.01 * abs(middle))


def _axes(covariance: np.ndarray, mean: float) -> tuple[float, float, float]:
    values, vectors = np.linalg.eigh(_matrix(covariance))
    own = float(values.mean()) - mean
    small, large = (math.sqrt(max(v - own, 0.01)) for v in values)
    return large, small, math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0


def _matrix(covariance: np.ndarray) -> np.ndarray:
    xx, yy, xy = covariance
    return np.array([[xx, xy], [xy, yy]])


def _nothing(text: str) -> BlindPsf:
    nan = float("nan")
    return BlindPsf(nan, nan, 0.0, float("inf"), nan, nan, 0.0, "not identifiable", text)
