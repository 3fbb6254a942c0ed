"""The obvious baselines: deconvolve every photo by itself, then splat. Wiener and Richardson-Lucy."""

from __future__ import annotations

import io
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import fftconvolve
from skimage.restoration import richardson_lucy

from ...core.colour import linear_to_srgb, srgb_to_linear
from ...core.errors import Cancelled
from ...core.files import make_folder, write_bytes
from ...core.imaging.fourier import wiener_photo
from ...core.imaging.medium import Medium
from ...core.imaging.spectrum import OPPONENT, noise_to_signal
from ...core.numbers import number
from ...core.photos.load import Photo
from ...core.progress import Progress


@dataclass(frozen=True)
class DeconvolutionNumbers:
    """Of the baselines' choices that need no truth."""

    spectrum_photos: int = number(12, "count", "photos that the noise is measured on, at most")
    iterations: tuple[int, ...] = number(
        (10, 25, 50, 100, 200),
        "count",
        "iterations of Richardson-Lucy among which one is chosen; more than the last take hours on a set of photos",
    )
    tried_photos: int = number(3, "count", "photos on which the number of iterations is chosen")
    residual: float = number(
        1.1, "standard deviations of the noise", "Morozov's discrepancy principle wants a factor a little above 1"
    )


NUMBERS = DeconvolutionNumbers()


def planes(photo: Photo) -> torch.Tensor:
    """[3, H, W] float32 sRGB."""
    full = np.float32(np.iinfo(photo.pixels.dtype).max)
    return torch.from_numpy(np.ascontiguousarray(photo.pixels.transpose(2, 0, 1)).astype(np.float32) / full)


def wiener(photos: Sequence[Photo], medium: Medium, ratio: str) -> list[Photo]:
    """Every photo after Wiener's filter, in 16 bits, masked pixels as they were.

    Args:
        ratio: noise-to-signal ratio, or 'measured': estimated from the photos' own spectra (no truth needed).
    """
    assert medium.psf is not None
    rotation = torch.from_numpy(OPPONENT).float()
    table: Any = None
    if ratio == "measured":
        chosen = photos[:: max(1, len(photos) // NUMBERS.spectrum_photos)]
        full = np.iinfo(photos[0].pixels.dtype).max
        measured = noise_to_signal((_light(p, medium).numpy() for p in chosen), medium.psf, 1 / full / 12**0.5)
        table = np.stack([measured.brightness, measured.colour, measured.colour])
    out = []
    for photo in photos:
        blurred = _light(photo, medium)
        if table is None:
            sharp = wiener_photo(blurred, medium.psf, float(ratio))
        else:  # brightness and colour apart, as they were measured
            turned = torch.einsum("ij,jhw->ihw", rotation, blurred)
            sharp = torch.einsum("ji,jhw->ihw", rotation, wiener_photo(turned, medium.psf, table))
        out.append(_with(photo, sharp, medium))
    return out


def lucy(
    photos: Sequence[Photo],
    medium: Medium,
    iterations: int,
    progress: Progress,
    threads: int = 1,
    folder: Path | None = None,
) -> list[Photo]:
    """Every photo after Richardson-Lucy (scikit-image's), mirrored beyond its border, in 16 bits.

    Args:
        threads: colour channels that are worked on at once.
        folder: photos that are there already are read, others are kept there.

    Raises:
        Cancelled: the user asked to stop; finished photos stay in `folder`.
    """
    out = []
    progress.stage(f"Richardson-Lucy, {iterations} iterations", len(photos))
    if folder is not None:
        make_folder(folder)
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for done, photo in enumerate(photos, start=1):
            if progress.cancelled():
                raise Cancelled("Stopped while photos were deconvolved", "Run it again with --resume")
            file = None if folder is None else folder / f"{photo.name}.npy"
            pixels: NDArray[np.uint8] | NDArray[np.uint16] | None = _kept(file, photo)
            if pixels is None:
                blurred = _light(photo, medium).numpy()
                sharp = np.stack(list(pool.map(lambda plane: _lucy_plane(plane, medium, iterations), blurred)))
                made = _with(photo, torch.from_numpy(np.clip(sharp, 0, 1)), medium).pixels
                if file is not None:
                    buffer = io.BytesIO()
                    np.save(buffer, made, allow_pickle=False)
                    write_bytes(file, buffer.getvalue())
                pixels = made
            out.append(replace(photo, pixels=pixels, alpha=None))  # over its background, as a picture
            progress.advance(done)
    return out


def lucy_iterations(photos: Sequence[Photo], medium: Medium, threads: int = 1) -> tuple[int, float]:
    """How many iterations of Richardson-Lucy the photos themselves ask for, by the discrepancy principle.

    The first number of `NUMBERS.iterations` at which the estimate, blurred again, agrees with the photo as well as
    the photo's noise allows; the last if none does. Needs no truth. Measured on the green channel of a
    few photos, away from their borders.

    Returns:
        The number, and the residual's rms there over the noise's standard deviation.
    """
    assert medium.psf is not None
    chosen = photos[:: max(1, len(photos) // NUMBERS.tried_photos)][: NUMBERS.tried_photos]
    full = np.iinfo(photos[0].pixels.dtype).max
    planes_tried = [_light(photo, medium).numpy() for photo in chosen]
    noise = noise_to_signal(planes_tried, medium.psf, 1 / full / 12**0.5).noise
    residual = float("inf")
    kernel = medium.psf.kernel().astype(np.float32)
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for iterations in NUMBERS.iterations:
            squares = pool.map(lambda each, n=iterations: _discrepancy(each[1], kernel, medium, n), planes_tried)
            residual = float(np.sqrt(np.mean(list(squares)))) / noise
            if residual <= NUMBERS.residual:
                return iterations, residual
    return NUMBERS.iterations[-1], residual


def _discrepancy(plane: NDArray[np.float32], kernel: NDArray[np.float32], medium: Medium, iterations: int) -> float:
    """Mean square of estimate * kernel - photo, away from the border."""
    again = fftconvolve(_lucy_plane(plane, medium, iterations), kernel, mode="same")
    rows, columns = (min(2 * (side // 2), length // 4) for side, length in zip(kernel.shape, plane.shape, strict=True))
    inside = (again - plane)[rows : plane.shape[0] - rows, columns : plane.shape[1] - columns]
    return float(np.mean(np.square(inside, dtype=np.float64)))


def _lucy_plane(plane: NDArray[np.float32], medium: Medium, iterations: int) -> NDArray[np.float32]:
    """[H, W] after so many iterations; light above 1 is left to the caller."""
    assert medium.psf is not None
    kernel = medium.psf.kernel().astype(np.float32)
    edge = [min(side // 2, length - 1) for side, length in zip(kernel.shape, plane.shape, strict=True)]
    padded = np.pad(plane, [(edge[0],) * 2, (edge[1],) * 2], mode="reflect")
    sharp = richardson_lucy(padded, kernel, num_iter=iterations, clip=False)
    inside = sharp[edge[0] : sharp.shape[0] - edge[0], edge[1] : sharp.shape[1] - edge[1]]
    return np.ascontiguousarray(inside, np.float32)


def _kept(file: Path | None, photo: Photo) -> NDArray[np.uint16] | None:
    try:
        pixels = None if file is None else np.load(file, allow_pickle=False)
    except (OSError, ValueError):
        return None
    return pixels if pixels is not None and pixels.shape == photo.pixels.shape else None


def _light(photo: Photo, medium: Medium) -> torch.Tensor:
    """[3, H, W] in the space in which the blur is linear."""
    values = planes(photo)
    return srgb_to_linear(values) if medium.blur_space == "linear" else values


def _with(photo: Photo, sharp: torch.Tensor, medium: Medium) -> Photo:
    values = sharp.clamp(0, 1)
    encoded = linear_to_srgb(values) if medium.blur_space == "linear" else values
    pixels: NDArray[np.uint16] = np.round(encoded.numpy().transpose(1, 2, 0) * 65535).astype(np.uint16)
    return replace(photo, pixels=np.ascontiguousarray(pixels), alpha=None)  # over its background, as a picture
