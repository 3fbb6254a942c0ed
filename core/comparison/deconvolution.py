"""The obvious baselines: deconvolve every photo by itself, then splat. Wiener and Richardson-Lucy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from skimage.restoration import richardson_lucy

from ..colour import linear_to_srgb, srgb_to_linear
from ..errors import Cancelled
from ..imaging.fourier import wiener_photo
from ..imaging.medium import Medium
from ..imaging.spectrum import OPPONENT, noise_to_signal
from ..photos.load import Photo
from ..progress import Progress

#: Photos that the noise is measured on.
_MEASURED = 12


def planes(photo: Photo) -> torch.Tensor:
    """[3, H, W] float32 sRGB."""
    full = np.float32(np.iinfo(photo.pixels.dtype).max)
    return torch.from_numpy(np.ascontiguousarray(photo.pixels.transpose(2, 0, 1)).astype(np.float32) / full)


def wiener(photos: Sequence[Photo], medium: Medium, ratio: str) -> list[Photo]:
    """Every photo after Wiener's filter, in 16 bits, masked pixels as they were.

    Args:
        ratio: noise-to-signal ratio, or 'measured' for what the photos' own spectra tell (no truth needed).
    """
    assert medium.psf is not None
    rotation = torch.from_numpy(OPPONENT).float()
    table: Any = None
    if ratio == "measured":
        chosen = photos[:: max(1, len(photos) // _MEASURED)]
        full = np.iinfo(photos[0].pixels.dtype).max
        measured = noise_to_signal((_light(p, medium).numpy() for p in chosen), medium.psf, 1 / full / 12**0.5)
        table = np.stack([measured.brightness, measured.colour, measured.colour])
    out = []
    for photo in photos:
        blurred = _light(photo, medium)
        if table is None:
            sharp = wiener_photo(blurred, medium.psf, float(ratio)).planes
        else:  # brightness and colour apart, as they were measured
            turned = torch.einsum("ij,jhw->ihw", rotation, blurred)
            sharp = torch.einsum("ji,jhw->ihw", rotation, wiener_photo(turned, medium.psf, table).planes)
        out.append(_with(photo, sharp, medium))
    return out


def lucy(photos: Sequence[Photo], medium: Medium, iterations: int, progress: Progress) -> list[Photo]:
    """Every photo after Richardson-Lucy (scikit-image's), mirrored beyond its border, in 16 bits."""
    assert medium.psf is not None
    kernel = medium.psf.kernel().astype(np.float32)
    rows, columns = (side // 2 for side in kernel.shape)
    out = []
    progress.note(f"Richardson-Lucy, {iterations} iterations on {len(photos)} photos")
    for photo in photos:
        if progress.cancelled():
            raise Cancelled("Stopped while photos were deconvolved", "Run it again with --resume")
        blurred = _light(photo, medium).numpy()
        edge = min(rows, blurred.shape[1] - 1), min(columns, blurred.shape[2] - 1)
        padded = np.pad(blurred, ((0, 0), (edge[0],) * 2, (edge[1],) * 2), mode="reflect")
        sharp = np.stack([richardson_lucy(plane, kernel, num_iter=iterations) for plane in padded])
        inside = sharp[:, edge[0] : sharp.shape[1] - edge[0], edge[1] : sharp.shape[2] - edge[1]]
        out.append(_with(photo, torch.from_numpy(np.ascontiguousarray(inside, np.float32)), medium))
    return out


def _light(photo: Photo, medium: Medium) -> torch.Tensor:
    """[3, H, W] in the space in which the blur is linear."""
    values = planes(photo)
    return srgb_to_linear(values) if medium.blur_space == "linear" else values


def _with(photo: Photo, sharp: torch.Tensor, medium: Medium) -> Photo:
    values = sharp.clamp(0, 1)
    encoded = linear_to_srgb(values) if medium.blur_space == "linear" else values
    pixels: NDArray[np.uint16] = np.round(encoded.numpy().transpose(1, 2, 0) * 65535).astype(np.uint16)
    return replace(photo, pixels=np.ascontiguousarray(pixels))
