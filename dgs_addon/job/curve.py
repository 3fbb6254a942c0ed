"""The run's curves as pixels: loss falling, accuracy rising. Knows no Blender."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .state import Mark

WIDTH, HEIGHT = 360, 120
#: sRGB; read well on Blender's dark and light themes.
LOSS_COLOUR, PSNR_COLOUR = (0.95, 0.55, 0.20), (0.35, 0.70, 1.00)
_BACKGROUND, _GRID = (0.11, 0.11, 0.12), (0.22, 0.22, 0.24)
_THICK = 3
_EDGE = 8


def draw(marks: Sequence[Mark], total: int | None) -> NDArray[np.float32]:
    """[HEIGHT, WIDTH, 4] in [0, 1], rows upwards as Blender's images: loss (logarithmic) and PSNR over steps."""
    picture = np.empty((HEIGHT, WIDTH, 4), np.float32)
    picture[:] = (*_BACKGROUND, 1.0)
    for share in (0.25, 0.5, 0.75):
        picture[round(share * HEIGHT), :, :3] = _GRID
        picture[:, round(share * WIDTH), :3] = _GRID
    end = max(total or 0, marks[-1].step if marks else 0, 1)
    losses = [(mark.step / end, np.log(max(mark.loss, 1e-9))) for mark in marks]
    accuracies = [(mark.step / end, mark.psnr) for mark in marks if mark.psnr is not None]
    _line(picture, losses, LOSS_COLOUR)
    _line(picture, accuracies, PSNR_COLOUR)
    return picture


def _line(picture: NDArray[np.float32], points: Sequence[tuple[float, float]], colour: tuple[float, ...]) -> None:
    if len(points) < 2:
        return
    x, y = (np.array(values, np.float64) for values in zip(*points, strict=True))
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
