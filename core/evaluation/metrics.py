"""How close an image is to another: PSNR, SSIM, and what each frequency band says.

All images are [H, W, 3] float arrays in [0, 1], sRGB-encoded as in the files, so that figures are
comparable with the literature's. PSNR alone hides invented speckle: read it with the bands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from .. import compiled
from .ssim_kernels import ssim_rows

Image = NDArray[np.floating]
Mask = NDArray[np.bool_]

#: PSNR of identical images; a number rather than infinity, which JSON cannot hold.
PSNR_MAXIMUM = 100.0
#: SSIM's window of 11 px from its middle to one end, a Gaussian of 1.5 px (Wang et al. 2004).
_TAPS = np.exp(-0.5 * (np.arange(6) / 1.5) ** 2)
_TAPS /= _TAPS[0] + 2 * _TAPS[1:].sum()
#: SSIM's constants for values in [0, 1] (the same).
_C1, _C2 = 0.01**2, 0.03**2


def counted(image: Image, mask: Mask | None, border: int) -> Mask:
    """Which pixels count: those in `mask`, further than `border` px from the frame."""
    keep = np.zeros(image.shape[:2], bool)
    height, width = keep.shape
    keep[border : height - border, border : width - border] = True
    return keep if mask is None else keep & mask


def psnr(image: Image, truth: Image, mask: Mask | None = None, border: int = 0) -> float:
    """Peak signal-to-noise ratio in dB over the pixels that count; NaN if none does.

    Args:
        image, truth: [H, W, 3] in [0, 1].
        mask: [H, W], True where a pixel counts.
        border: px left out on every side.
    """
    _same_size(image, truth)
    keep = counted(truth, mask, border)
    if not keep.any():
        return float("nan")
    a, b = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    error = np.mean(np.square(a - b)) if keep.all() else np.mean(np.square(a[keep] - b[keep]))
    return float(min(PSNR_MAXIMUM, -10.0 * np.log10(max(error, 1e-30))))


def ssim(image: Image, truth: Image, mask: Mask | None = None, border: int = 0) -> float:
    """Structural similarity as Wang et al. 2004 define it (Gaussian window, sigma 1.5 px).

    The mean over the pixels that count; NaN where the image is smaller than the window (11 px).
    """
    _same_size(image, truth)
    keep = counted(truth, mask, border)
    if min(truth.shape[:2]) < 11 or not keep.any():
        return float("nan")
    a, b = (np.ascontiguousarray(one, np.float64) for one in (image, truth))
    sums = np.zeros(len(a))
    compiled.run(ssim_rows, len(a), a, b, keep, _TAPS, _C1, _C2, sums, grain=16)
    return float(sums.sum() / (keep.sum() * a.shape[2]))


def _frequency(height: int, width: int) -> NDArray[np.float64]:
    """Radial frequency in cycles/px of each cosine coefficient, [H, W]."""
    return np.hypot(np.arange(height)[:, None] / (2 * height), np.arange(width)[None] / (2 * width))


def low_passed(image: Image, cutoff: float) -> NDArray[np.float64]:
    """The image without what is finer than `cutoff` cycles/px (a sharp cut, mirrored borders)."""
    spectrum = fft.dctn(np.asarray(image, np.float64), axes=(0, 1), norm="ortho")
    spectrum[_frequency(*image.shape[:2]) > cutoff] = 0
    return np.asarray(fft.idctn(spectrum, axes=(0, 1), norm="ortho"))


def low_passed_truth_psnr(truth: Image, cutoff: float, mask: Mask | None = None, border: int = 0) -> float:
    """PSNR in dB of the truth itself without what is finer than `cutoff` cycles/px.

    What a perfect method would reach that has all the truth up to there and nothing beyond.
    """
    return psnr(np.clip(low_passed(truth, cutoff), 0, 1), truth, mask, border)


@dataclass(frozen=True)
class Band:
    """How one band of frequencies came through.

    Attributes:
        finest, coarsest: periods in px that bound the band.
        gain: <image, truth> / <truth, truth>: 1 if all of the band is there, 0 if it is missing
            or invented.
        correlation: <image, truth> / (|image| |truth|): 1 if all that is there is true.
        energy: |image| / |truth|; above `gain` by what was invented.
    """

    finest: float
    coarsest: float
    gain: float
    correlation: float
    energy: float


def bands(image: Image, truth: Image, periods: Sequence[tuple[float, float]]) -> list[Band]:
    """Compares the detail of each band with periods from `coarsest` to `finest` px; without any truth there NaN.

    Args:
        image, truth: [H, W, 3] in [0, 1]; transformed once for all bands.
        periods: (coarsest, finest) of each band.
    """
    _same_size(image, truth)
    radius = _frequency(*truth.shape[:2])
    spectra = [fft.dctn(np.asarray(i, np.float64), axes=(0, 1), norm="ortho") for i in (image, truth)]
    found = []
    for coarsest, finest in periods:
        inside = (radius >= 1.0 / coarsest) & (radius < 1.0 / finest)
        a, b = (spectrum[inside].ravel() for spectrum in spectra)
        both, own, true = float(a @ b), float(a @ a), float(b @ b)
        if true <= 1e-12:
            found.append(Band(finest, coarsest, float("nan"), float("nan"), float("nan")))
            continue
        correlation = both / np.sqrt(own * true) if own > 1e-12 else 0.0
        found.append(Band(finest, coarsest, both / true, float(correlation), float(np.sqrt(own / true))))
    return found


def edge_sharpness(image: Image, truth: Image, share: float = 0.02) -> float:
    """Gradient across the truth's strongest edges, as a share of the truth's own.

    1 is as sharp as the truth; a blurred edge is less. The gradient is taken along the truth's own
    gradient, so that speckle beside the edge does not count as sharpness.

    Args:
        share: share of the pixels (those with the steepest gradient in the truth) that are read.
    """
    _same_size(image, truth)
    gradients = [np.stack(np.gradient(np.asarray(i, np.float64).mean(axis=2))) for i in (image, truth)]
    steepness = np.hypot(*gradients[1])
    edges = (steepness >= np.quantile(steepness, 1 - share)) & (steepness > 0)
    if not edges.any():
        return float("nan")
    direction = gradients[1][:, edges] / steepness[edges]
    return float(np.sum(gradients[0][:, edges] * direction) / np.sum(steepness[edges]))


def _same_size(image: Image, truth: Image) -> None:
    if image.shape != truth.shape:
        raise ValueError(f"images differ in size: {image.shape} and {truth.shape}")
