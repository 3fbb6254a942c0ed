"""What the panel's icon shows, as pixels: the twin so far above the run's curves. Knows no Blender."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.npy import load_npy
from .state import Mark

#: Size of the curves in px.
WIDTH, HEIGHT = 360, 120
#: sRGB; read well on Blender's dark and light themes.
LOSS_COLOUR, PSNR_COLOUR = (0.95, 0.55, 0.20), (0.35, 0.70, 1.00)
_BACKGROUND, _GRID = (0.11, 0.11, 0.12), (0.22, 0.22, 0.24)
#: Thickness of a curve, and the border around both, in px.
_THICK = 3
_EDGE = 8
#: No figure of a run is larger (dB, or the logarithm of a loss); differences of larger ones would be infinite.
_HIGHEST = 1e6
#: Blender draws icons as squares of this many px: above the twin, below the curves.
SIDE = WIDTH
#: (width, height) in px of the twin's part.
ABOVE = (SIDE, SIDE - HEIGHT)


def read_preview(path: Path) -> NDArray[np.float32]:
    """[ABOVE height, ABOVE width, 4] in [0, 1], rows upwards, of a preview.npy ([H, W, 3] uint8, rows downwards).

    Raises:
        OSError, ValueError: it cannot be read, or holds no picture.
    """
    pixels = load_npy(path)
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


def draw_curves(marks: Sequence[Mark], total: int | None) -> NDArray[np.float32]:
    """[HEIGHT, WIDTH, 4] in [0, 1], rows upwards as Blender's images: loss (logarithmic) and PSNR over steps."""
    picture = np.empty((HEIGHT, WIDTH, 4), np.float32)
    picture[:] = (*_BACKGROUND, 1.0)
    for share in (0.25, 0.5, 0.75):
        picture[round(share * HEIGHT), :, :3] = _GRID
        picture[:, round(share * WIDTH), :3] = _GRID
    end = max(total or 0, *(mark.step for mark in marks), 1)
    losses = [(mark.step / end, np.log(max(mark.loss, 1e-9))) for mark in marks]
    accuracies = [(mark.step / end, mark.psnr) for mark in marks if mark.psnr is not None]
    _line(picture, losses, LOSS_COLOUR)
    _line(picture, accuracies, PSNR_COLOUR)
    return picture


def _line(picture: NDArray[np.float32], points: Sequence[tuple[float, float]], colour: tuple[float, ...]) -> None:
    if len(points) < 2:
        return
    x, y = (np.array(values, np.float64) for values in zip(*points, strict=True))
    y = np.clip(y, -_HIGHEST, _HIGHEST)
    low, high = float(y.min()), float(y.max())
    y = (y - low) / max(high - low, 1e-9)
    first, last = (round(_EDGE + share * (WIDTH - 1 - 2 * _EDGE)) for share in (x[0], x[-1]))
    columns = np.arange(first, last + 1)
    heights = np.interp((columns - _EDGE) / (WIDTH - 1 - 2 * _EDGE), x, y) * (HEIGHT - 1 - 2 * _EDGE) + _EDGE
    rows = np.round(heights).astype(int)
    before = np.concatenate([rows[:1], rows[:-1]])
    for column, row, previous in zip(columns, rows, before, strict=True):
        bottom, top = sorted((row, previous))  # steep pieces are drawn without gaps
        picture[max(bottom - _THICK // 2, 0) : top + _THICK // 2 + 1, column, :3] = colour
