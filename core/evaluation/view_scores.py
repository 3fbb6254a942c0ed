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
#: Period in px of the finest detail that a grid of px holds.
NYQUIST_PERIOD = 2.0


@dataclass
class ViewScores:
    """Scores of one view; None where there is nothing to compare with."""

    name: str
    degraded: dict[str, float | None] | None = None
    sharp: dict[str, float | None] | None = None
    low_passed: float | None = None
    bands: list[dict[str, float | None]] = field(default_factory=list)
    edge_sharpness: float | None = None

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


def mean_of(values: Sequence[float | None]) -> float | None:
    """Mean of what is there; None if nothing is."""
    there = [value for value in values if value is not None]
    return round(float(np.mean(there)), 4) if there else None


def rounded(value: float) -> float | None:
    """To 4 digits; JSON has no NaN, and no infinity."""
    return round(value, 4) if np.isfinite(value) else None
