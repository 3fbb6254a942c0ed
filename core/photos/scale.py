"""Makes photos and masks smaller."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Pixels = NDArray[np.uint8] | NDArray[np.uint16]


def size_within(width: int, height: int, max_size: int | None) -> tuple[int, int]:
    """(width, height) with the longest side at most `max_size`, the aspect kept to a pixel."""
    longest = max(width, height)
    if max_size is None or longest <= max_size:
        return width, height
    return max(1, round(width * max_size / longest)), max(1, round(height * max_size / longest))


def resized(pixels: Pixels, width: int, height: int) -> Pixels:
    """[H, W, 3] or [H, W] scaled by an antialiased Lanczos filter (a = 3); keeps its type."""
    if pixels.ndim == 2:
        return _plane(pixels, width, height)
    full = np.iinfo(pixels.dtype).max
    if pixels.dtype == np.uint8:
        return np.asarray(Image.fromarray(pixels).resize((width, height), Image.Resampling.LANCZOS)).copy()
    planes = [
        np.asarray(
            Image.fromarray(pixels[:, :, c].astype(np.float32)).resize((width, height), Image.Resampling.LANCZOS)
        )
        for c in range(pixels.shape[2])
    ]
    return np.clip(np.stack(planes, axis=2) + 0.5, 0, full).astype(np.uint16)


def _plane(pixels: Pixels, width: int, height: int) -> Pixels:
    if pixels.dtype == np.uint16:
        return resized(pixels[:, :, None], width, height)[:, :, 0]
    return np.asarray(Image.fromarray(pixels).resize((width, height), Image.Resampling.LANCZOS)).copy()


def resized_mask(mask: NDArray[np.bool_], width: int, height: int) -> NDArray[np.bool_]:
    """[H, W] bool; a pixel counts if at least half of what it covers does."""
    if mask.shape == (height, width):
        return mask.copy()
    grey = Image.fromarray(mask.astype(np.float32))
    result: NDArray[np.bool_] = np.asarray(grey.resize((width, height), Image.Resampling.BOX)) >= 0.5
    return result
