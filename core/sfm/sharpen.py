"""Undoes the given blur in the grey photos before features are sought (Wiener, 1949).

Measured: COLMAP's default thresholds find hardly a feature in photos blurred by sigma 5, and all
they need in the filtered ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

#: Share of green etc. in luma (Rec. 709); on sRGB-encoded values.
LUMA = (0.2126, 0.7152, 0.0722)


def luma(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float32]:
    """[H, W, 3] sRGB -> [H, W] float32 in [0, 1], still sRGB-encoded.

    Averaging three quantised channels in float keeps some of what 8 bits rounded away.
    """
    full = float(np.iinfo(pixels.dtype).max)
    weights = np.array(LUMA, np.float32) / np.float32(full)
    return pixels.astype(np.float32) @ weights


def wiener(
    image: NDArray[np.float32], kernel: NDArray[np.float64], noise_to_signal: float = 1.0e-3
) -> NDArray[np.float32]:
    """conj(H) / (|H|^2 + n) applied by FFT, normalised to gain 1 at frequency 0.

    Args:
        image: [H, W] float32.
        kernel: [k, k], k odd, centred, sum 1.
        noise_to_signal: n, power of noise over power of signal.

    Returns:
        [H, W] float32. The border is reflected and tapered into its opposite side, so that the
        periodic transform sees no step; within about a kernel's radius of it the result is a guess.
    """
    if kernel.ndim != 2 or kernel.shape[0] % 2 == 0 or kernel.shape[1] % 2 == 0:
        raise ValueError(f"kernel must be [odd, odd], not {kernel.shape}")
    height, width = image.shape
    pad_y, pad_x = kernel.shape[0], kernel.shape[1]
    size_y, size_x = fft.next_fast_len(height + 2 * pad_y, True), fft.next_fast_len(width + 2 * pad_x, True)
    mean = float(image.mean())
    padded = _tapered(image - mean, (pad_y, size_y - height - pad_y), (pad_x, size_x - width - pad_x))
    point = np.zeros((size_y, size_x), np.float32)
    point[: kernel.shape[0], : kernel.shape[1]] = kernel
    point = np.roll(point, (-(kernel.shape[0] // 2), -(kernel.shape[1] // 2)), (0, 1))
    transfer = fft.rfft2(point)
    gain = np.conj(transfer) * (1.0 + noise_to_signal) / (np.abs(transfer) ** 2 + noise_to_signal)
    filtered = fft.irfft2(fft.rfft2(padded) * gain, s=padded.shape)
    result: NDArray[np.float32] = filtered[pad_y : pad_y + height, pad_x : pad_x + width] + np.float32(mean)
    return result


def _tapered(image: NDArray[np.float32], rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float32]:
    padded = np.pad(image, (rows, columns), mode="symmetric")
    for axis, (before, after) in enumerate((rows, columns)):
        ramp = np.ones(padded.shape[axis], np.float32)
        ramp[:before] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(before) + 0.5) / before)
        ramp[-after:] = 0.5 + 0.5 * np.cos(np.pi * (np.arange(after) + 0.5) / after)
        padded *= ramp[:, None] if axis == 0 else ramp[None, :]
    return padded


def as_bytes(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """[H, W] float32 in [0, 1] -> uint8, rounded and clipped."""
    result: NDArray[np.uint8] = np.clip(image * 255.0 + 0.5, 0, 255).astype(np.uint8)
    return result
