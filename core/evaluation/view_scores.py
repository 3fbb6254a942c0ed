"""How well one view of a twin is: against its photo through the medium, and sharp against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .metrics import bands, edge_sharpness, low_passed_truth_psnr, psnr, ssim

Image = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Bands of periods (coarsest, finest) in px that are compared with the truth.
BANDS = ((40.0, 20.0), (20.0, 14.0), (14.0, 10.0), (10.0, 7.0), (7.0, 4.0))
#: Border in px that `psnr_inside` leaves out: interpolation and missing light change scores there.
BORDER = 30
#: Names of the nine parts of a frame, row by row.
PARTS = tuple(
    f"in the {vertical}{horizontal}".replace("middle middle", "middle").rstrip()
    for vertical in ("upper ", "middle ", "lower ")
    for horizontal in ("left", "middle", "right")
)
#: Period in px of the finest detail that a grid of px holds.
NYQUIST_PERIOD = 2.0


@dataclass
class ViewScores:
    """Scores of one view; None where there is nothing to compare with.

    Attributes:
        degraded: through the medium against the photo; sharp: against the truth.
        unexplained: squared error against the photo over the photo's variance: 0 for a perfect twin, 1 for one that
            shows the photo's mean colours.
        parts: [9] each part's share of the squared error (`PARTS`).
        moved: px by which the camera stood beside where it was found, by the photo's learned path; None where it is
            seen from where it was found or given.
    """

    name: str
    degraded: dict[str, float | None] | None = None
    sharp: dict[str, float | None] | None = None
    low_passed: float | None = None
    bands: list[dict[str, float | None]] = field(default_factory=list)
    edge_sharpness: float | None = None
    unexplained: float | None = None
    parts: list[float] | None = None
    moved: float | None = None

    def add_photo(self, degraded: Image, photo: Image, mask: Mask | None, matched: float) -> None:
        """Compares the render through the medium with the photo, both [H, W, 3] in [0, 1].

        Args:
            matched: PSNR in dB with the photo's own gains taken away.
        """
        self.degraded = {
            "psnr": rounded(psnr(degraded, photo, mask)),
            "ssim": rounded(ssim(degraded, photo, mask)),
            "psnr_matched": rounded(matched),
        }
        self.unexplained, self.parts = _unexplained(degraded, photo, mask)

    def add_halves(self, exposed: Image, photo: Image, mask: Mask | None) -> None:
        """Adds the PSNR of the render as each half of the photo would have exposed the other (`evaluation.halves`).

        What is unexplained is judged by it, too: nothing says the exposure of a photo that no training saw.
        """
        assert self.degraded is not None
        self.degraded["psnr_halves"] = rounded(psnr(exposed, photo, mask))
        self.unexplained, self.parts = _unexplained(exposed, photo, mask)

    def add_truth(self, sharp: Image, truth: Image, mask: Mask | None, cutoff: float | None) -> None:
        """Compares the sharp render with the sharp truth, both [H, W, 3] in [0, 1].

        Args:
            cutoff: cycles per px beyond which one photo holds nothing; None where it holds all.
        """
        self.sharp = {
            "psnr": rounded(psnr(sharp, truth, mask)),
            "ssim": rounded(ssim(sharp, truth, mask)),
            "psnr_inside": rounded(psnr(sharp, truth, mask, BORDER)),
        }
        if cutoff is not None:
            self.low_passed = rounded(low_passed_truth_psnr(truth, cutoff, mask))
        for (coarsest, finest), one in zip(BANDS, bands(sharp, truth, BANDS), strict=True):
            self.bands.append(
                {
                    "coarsest": coarsest,
                    "finest": finest,
                    "gain": rounded(one.gain),
                    "correlation": rounded(one.correlation),
                    "energy": rounded(one.energy),
                }
            )
        self.edge_sharpness = rounded(edge_sharpness(sharp, truth))


def _unexplained(degraded: Image, photo: Image, mask: Mask | None) -> tuple[float | None, list[float] | None]:
    """Share of the photo's variance (colours apart) that the render leaves, and the nine parts' shares of it."""
    keep = np.ones(photo.shape[:2], bool) if mask is None else mask
    # (channel by channel: numpy is slow along an axis of three)
    squares = sum(np.square(degraded[..., c] - photo[..., c]) for c in range(photo.shape[2])) * keep
    variance = float(sum(photo[..., c][keep].var() for c in range(photo.shape[2]))) if keep.any() else 0.0
    if variance <= 0.0:
        return None, None
    rows = (np.arange(photo.shape[0]) * 3 // photo.shape[0])[:, None]
    columns = (np.arange(photo.shape[1]) * 3 // photo.shape[1])[None, :]
    sums = np.bincount((rows * 3 + columns).ravel(), squares.ravel(), minlength=9)
    total = float(sums.sum())
    share = total / float(keep.sum()) / variance
    return round(share, 6), None if total == 0.0 else [round(float(v) / total, 4) for v in sums]


def mean_of(values: Sequence[float | None]) -> float | None:
    """Mean of what is there; None if nothing is."""
    there = [value for value in values if value is not None]
    return round(float(np.mean(there)), 4) if there else None


def rounded(value: float) -> float | None:
    """To 4 digits; JSON has no NaN, and no infinity."""
    return round(value, 4) if np.isfinite(value) else None
