"""What a photo's residual says of the picture without motion: Wiener's inverse of the camera's way, part by part.

A way x(t) of what is seen has the transfer k(f) = mean over t of exp(-2 pi i f . x(t)). Of the residual r, linear
light,

    k* / (|k|^2 + n) r

is what is missing in the picture, in the band that the way let through. Where a camera turned about its own axis, or
passed something near, ways differ over the photo: it is cut into parts that fade into each other, each with its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from ...numbers import number

#: [K, 2] px along x and y of the way of what is seen in a part of the photo, given the part's weights [H, W].
Way = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class InverseSettings:
    """Numbers of the inverse."""

    noise: float = number(
        0.05,
        "power, over that of what is missing",
        "of the residual that is none of the picture's: below it the inverse leaves things as they are",
        "photos shaken along twins of copr and banana, true cameras and paths, twins of the restored photos, held-out"
        " views: 0.1 31.50, 31.86 dB, 0.03 31.49, 31.99; restored again, 0.3 31.41, 31.40, 0.1 31.36, 31.92",
    )
    parts: int = number(3, "count", "along each side of a photo, whose ways are taken to be one; a first choice")
    places: int = number(33, "count", "of a way that make its transfer, as of `paths.curved_ways`")
    beyond: int = number(32, "px", "around a part at least that its light may come from")


INVERSE = InverseSettings()


def inverted(residual: Tensor, way: Way, numbers: InverseSettings = INVERSE) -> Tensor:
    """[3, H, W] what is missing in the picture without motion, given the photo's residual there; linear light."""
    height, width = residual.shape[1:]
    missing = torch.zeros_like(residual)
    for weights in fading_parts(height, width, numbers.parts):
        rows, columns = (weights.amax(dim=1) > 0).nonzero()[:, 0], (weights.amax(dim=0) > 0).nonzero()[:, 0]
        top, bottom, left, right = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
        places = way(weights)
        pad = max(numbers.beyond, math.ceil(2.0 * float(places.abs().max())))
        part = (residual * weights)[:, top:bottom, left:right]
        wide = _inverted_alike(torch.nn.functional.pad(part, (pad, pad, pad, pad)), places, numbers.noise)
        above, beside = max(0, top - pad), max(0, left - pad)
        below, end = min(height, bottom + pad), min(width, right + pad)
        skip_down, skip_right = above - (top - pad), beside - (left - pad)
        missing[:, above:below, beside:end] += wide[
            :, skip_down : skip_down + below - above, skip_right : skip_right + end - beside
        ]
    return missing


def fading_parts(height: int, width: int, count: int) -> Iterator[Tensor]:
    """[H, W] weights of `count` x `count` parts that overlap; together they are 1 everywhere."""
    for down in _fading(height, count):
        for right in _fading(width, count):
            yield down[:, None] * right[None, :]


def _fading(length: int, count: int) -> list[Tensor]:
    """[length] weights of parts along one side, largest at evenly spaced places from one end to the other."""
    at = (torch.arange(length) + 0.5) / length * (count - 1)
    return [(1.0 - (at - middle).abs()).clamp(min=0.0) for middle in range(count)] if count > 1 else [at * 0 + 1]


def transfer_of(places: Tensor, height: int, width: int) -> Tensor:
    """[H, W // 2 + 1] complex: the transfer of a way [K, 2], px along x and y, at the frequencies of `rfft2`."""
    down, right = torch.fft.fftfreq(height), torch.fft.rfftfreq(width)
    along_y = torch.exp(-2j * math.pi * down[:, None] * places[None, :, 1])
    along_x = torch.exp(-2j * math.pi * places[:, 0, None] * right[None, :])
    return along_y @ along_x / len(places)


def _inverted_alike(residual: Tensor, places: Tensor, noise: float) -> Tensor:
    """The same of a photo [3, H, W] that one way blurs."""
    size = residual.shape[1], residual.shape[2]
    transfer = transfer_of(places, *size)
    inverse = transfer.conj() / (transfer.abs().square() + noise)
    return torch.fft.irfft2(torch.fft.rfft2(residual) * inverse, s=size)
