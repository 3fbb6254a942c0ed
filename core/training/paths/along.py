"""How a photo that was taken along a path changes with the path and with the camera's curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...compiled import run
from ...forward.collecting import decoding_table
from .slopes import Looked, change_by, sampled, slopes_along
from .step_kernels import change_rows, slope_rows
from .tone import slopes_in_curve


@dataclass(frozen=True)
class Along:
    """Slopes of a photo where a step looks at it.

    Attributes:
        right, down: [M + 1, 3, h, w] by a px's shift of each part of the path.
        by_curve: [2, 3, h, w] by the toe and the shoulder of its camera's curve; None where that was not asked.
    """

    right: Tensor
    down: Tensor
    by_curve: Tensor | None

    @staticmethod
    def of(looked: Looked, basis: Tensor, with_curve: bool) -> Along:
        """Of a photo along its path.

        Args:
            basis: [M + 1, T] share of frame t in part m, or [M + 1, T, H + 2m, 1] in each row of it, or
                [M + 1, T, 1, W + 2m] in each column; the first is the photo.
        """
        found = _in_one_pass(looked, basis)
        if found is None:
            return Along.in_torch(looked, basis, with_curve)
        return found if with_curve else Along(found.right, found.down, None)

    @staticmethod
    def in_torch(looked: Looked, basis: Tensor, with_curve: bool) -> Along:
        """The same in plain torch, on any device and behind any effects: the specification."""
        slope = slopes_along(looked, basis)
        right, down = slope(0, 1), slope(1, 0)
        if not with_curve:
            return Along(right, down, None)
        return Along(right, down, slopes_in_curve(looked, basis[0] if basis.dim() == 4 else None))


def changed_by(looked: Looked, shares: Tensor) -> Tensor:
    """[3, h, w] (sRGB) by which a photo changes with the frames' light; `slopes.change_by` is the specification.

    Args:
        shares: [T, H + 2m, 1] of each frame's light in each row, or [T, 1, W + 2m] in each column, which add up to
            none.
    """
    if shares.shape[-1] > 1 or not _in_memory(looked):
        return change_by(looked, shares)
    used = shares[..., 0].any(dim=1).nonzero()[:, 0]
    rows = sampled(looked.exposed, shares[used], looked.at)[..., 0].float().contiguous()
    _, height, width = looked.at.of_planes(looked.exposed.degraded).shape
    out = torch.empty((3, height, width))
    run(
        change_rows,
        3 * height,
        *_planes(looked),
        _where(looked),
        used.numpy(),
        rows.numpy(),
        *_curve(looked),
        out.numpy(),
        grain=8,
    )
    return out


def _in_memory(looked: Looked) -> bool:
    """Whether all is in memory and the frames' light meets no other effect."""
    frames = looked.whole
    return looked.exposed.together is None and frames.device.type == "cpu" and frames.dtype == torch.float32


def _planes(looked: Looked) -> list[NDArray[np.float32]]:
    """Frames and photo."""
    return [planes.contiguous().numpy() for planes in (looked.whole, looked.exposed.degraded)]


def _where(looked: Looked) -> NDArray[np.int64]:
    """First row and column that are looked at, every how many, and the frames' margin."""
    at = looked.at
    return np.array([at.rows.start, at.columns.start, at.rows.step or 1, looked.exposed.shot.margin], np.int64)


def _curve(looked: Looked) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Toe and shoulder of the camera's own curve, and the table of sRGB's."""
    return np.array([looked.curve.toe, looked.curve.shoulder], np.float32), decoding_table()


def _in_one_pass(looked: Looked, basis: Tensor) -> Along | None:
    """By a compiled kernel, where that is possible."""
    columns = basis.dim() == 4 and basis.shape[-1] > 1
    if columns or not _in_memory(looked):
        return None
    exposed, at = looked.exposed, looked.at
    _, height, width = at.of_planes(exposed.degraded).shape
    shares = basis[:, :, None] if basis.dim() == 2 else sampled(exposed, basis, at)[..., 0]
    shares = shares.float().expand(-1, -1, height).contiguous()
    slopes = torch.empty((2 * len(basis), 3, height, width))
    right, down, by_curve = slopes[: len(basis)], slopes[len(basis) :], torch.empty((2, 3, height, width))
    run(
        slope_rows,
        3 * height,
        *_planes(looked),
        _where(looked),
        shares.numpy(),
        *_curve(looked),
        *(planes.numpy() for planes in (right, down, by_curve)),
        grain=8,
    )
    return Along(right, down, by_curve)
