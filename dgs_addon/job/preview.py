"""Small pictures as Blender's icons want them, made on the worker's thread. Knows no Blender."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import curve

#: Blender draws icons as squares of this many px: above the twin, below the curves.
SIDE = curve.WIDTH
#: (width, height) in px of the twin's part.
ABOVE = (SIDE, SIDE - curve.HEIGHT)


def read_preview(path: Path) -> NDArray[np.float32]:
    """[ABOVE height, ABOVE width, 4] in [0, 1], rows upwards, of a preview.npy ([H, W, 3] uint8, rows downwards).

    Raises:
        OSError, ValueError: it cannot be read, or holds no picture.
    """
    pixels = np.load(path, allow_pickle=False)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8 or not pixels.size:
        raise ValueError(f"'{path}' holds no picture")
    whole = np.ones((*pixels.shape[:2], 4), np.float32)
    whole[..., :3] = pixels[::-1].astype(np.float32) / np.float32(255)
    return fitted(whole, *ABOVE)


def fitted(pixels: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """[height, width, 4]: the whole picture [H, W, 4] as large as it fits, in the middle of nothing."""
    scale = min(width / pixels.shape[1], height / pixels.shape[0])
    columns, rows = max(1, int(pixels.shape[1] * scale)), max(1, int(pixels.shape[0] * scale))
    near = pixels[(np.arange(rows) / scale).astype(int)][:, (np.arange(columns) / scale).astype(int)]
    frame = np.zeros((height, width, 4), np.float32)
    top, left = (height - rows) // 2, (width - columns) // 2
    frame[top : top + rows, left : left + columns] = near
    return frame
