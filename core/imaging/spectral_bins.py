"""Mean power of pictures in bins of frequency: the one place that windows, transforms and averages spectra."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def frequency_plane(h: int, w: int) -> tuple[Array, Array]:
    """Vertical [h, 1] and horizontal [1, w // 2 + 1] frequencies of a real transform's coefficients, cycles/px."""
    return np.fft.fftfreq(h)[:, None], np.fft.rfftfreq(w)[None, :]


def polar_index(h: int, w: int, edges: Array, directions: int) -> NDArray[np.int64]:
    """[h, w // 2 + 1] bin of each coefficient: ring * directions + direction; -1 outside of all rings.

    Args:
        edges: [rings + 1] radial frequencies that bound the rings, rising.
        directions: of half a turn; the first one's middle is horizontal.
    """
    fy, fx = frequency_plane(h, w)
    ring = np.searchsorted(edges, np.hypot(fx, fy), side="right") - 1
    turn = np.floor((np.arctan2(fy, fx) % np.pi) / np.pi * directions + 0.5).astype(int) % directions
    return np.where((ring >= 0) & (ring < len(edges) - 1), ring * directions + turn, -1)


class SpectralBins:
    """Bins of frequency for pictures of one size.

    Args:
        shape: height and width of the pictures.
        index: [h, w // 2 + 1] or as many values in a row: bin of each coefficient, -1 for none.
        count: of bins.

    Attributes:
        window: [h, w] Hann's, whose zeros lie outside.
        counts: [count] coefficients in each bin.
    """

    def __init__(self, shape: tuple[int, int], index: NDArray[np.int64], count: int) -> None:
        h, w = shape
        self.window = np.outer(np.hanning(h + 2)[1:-1], np.hanning(w + 2)[1:-1])
        self._used = index.ravel() >= 0
        self._index = index.ravel()[self._used]
        self.counts = np.bincount(self._index, minlength=count)

    def mean_power(self, centred: NDArray[np.floating]) -> Array:
        """[C, count] power spectral density of pictures [C, h, w] of mean 0; bins without a coefficient are 0.

        White noise of variance v gives v.
        """
        power = np.abs(np.fft.rfft2(centred * self.window)) ** 2 / np.square(self.window).sum()
        sums = np.stack([np.bincount(self._index, p.ravel()[self._used], len(self.counts)) for p in power])
        return np.asarray(sums / np.maximum(self.counts, 1))

    def power_of(self, values: NDArray[np.floating]) -> Array:
        """[count] power spectral density of one picture [h, w], the mean under the window taken off first."""
        v = np.asarray(values, np.float64)
        mean = float((v * self.window).sum() / self.window.sum())
        return np.asarray(self.mean_power((v - mean)[None])[0])
