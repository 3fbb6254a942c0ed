"""Straight ways of a camera that explain a shaken photo, of all directions and lengths at once.

The picture without motion is convolved with each, which is nearly what a turn of the camera does, in one transform: a
way's share of the photo at frequency f is the mean of exp(-2 pi i f . way(t)), for a straight one
sinc(length * (f along it)). So spectra are summed up along each direction first, and every length asks these sums.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...colour import srgb_to_linear
from .settings import CameraPathSettings

#: Bins of the frequencies along a way: where ways of 180 px pass, half a bin is 0.008 of a cycle.
_BINS = 8192
#: Cycles per px, a little above the highest frequency of a picture along any direction.
_HIGHEST = 0.7072

Array = NDArray[np.float64]


def explaining_ways(
    still: Tensor, photo: Tensor, longest: float, settings: CameraPathSettings
) -> list[tuple[float, float]]:
    """Straight ways (x, y), px, that explain a photo best, each better than those of the directions beside it.

    Args:
        still, photo: as of `left_by_ways`; longest: px, of any way.
    """
    count, turns = int(math.log(longest) / math.log(settings.again_factor)), settings.again_turns
    angles, lengths = np.pi * np.arange(turns) / turns, settings.again_factor ** np.arange(count)
    rests = left_by_ways(still, photo, angles, lengths)
    found = [
        (float(rests[turn].min()), length * math.cos(angle), length * math.sin(angle))
        for turn, (angle, length) in enumerate(zip(angles, lengths[rests.argmin(axis=1)], strict=True))
    ]
    beside = [(found[turn - 1][0], found[(turn + 1) % len(found)][0]) for turn in range(len(found))]
    lowest = sorted(f for f, (left, right) in zip(found, beside, strict=True) if f[0] <= left and f[0] <= right)
    return [(x, y) for _, x, y in lowest[: settings.again_starts]]


def left_by_ways(still: Tensor, photo: Tensor, angles: Array, lengths: Array) -> Array:
    """[A, L] what straight ways leave of a photo, |photo - transfer still|^2 less its own power.

    Args:
        still: [3, H, W] sRGB without motion; photo: the same with it.
        angles: [A] radians, from the picture's x towards its y; lengths: [L] px.
    """
    together, alone = (spectrum.numpy().ravel() for spectrum in _spectra(still, photo))
    height, width = photo.shape[1:]
    down = np.fft.fftfreq(height).astype(np.float32)[:, None]
    right = np.fft.rfftfreq(width).astype(np.float32)
    transfer = np.sinc(lengths[:, None] * (np.arange(_BINS) + 0.5) * (_HIGHEST / _BINS))
    left = np.empty((len(angles), len(lengths)))
    for row, angle in zip(left, angles, strict=True):
        along = np.abs(right * np.float32(np.cos(angle)) + down * np.float32(np.sin(angle)))
        bins = (along * np.float32(_BINS / _HIGHEST)).astype(np.int32).ravel()
        of_both, of_still = (np.bincount(bins, spectrum, _BINS) for spectrum in (together, alone))
        row[:] = transfer**2 @ of_still - 2.0 * (transfer @ of_both)
    return left


def _spectra(still: Tensor, photo: Tensor) -> tuple[Tensor, Tensor]:
    """[H, W / 2 + 1] real part of still* photo, and |still|^2, of windowed light and summed over channels."""
    height, width = photo.shape[1:]
    window = torch.hann_window(height)[:, None] * torch.hann_window(width)[None, :]
    lights = (srgb_to_linear(planes) for planes in (still, photo))
    of_still, of_photo = (torch.fft.rfft2((light - light.mean(dim=(1, 2), keepdim=True)) * window) for light in lights)
    together = of_still.real * of_photo.real + of_still.imag * of_photo.imag
    return together.sum(dim=0), (of_still.real.square() + of_still.imag.square()).sum(dim=0)
