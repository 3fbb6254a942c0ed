"""How a photo that was taken along a path changes with the path and with the camera's curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..compiled import run
from ..forward.collecting import decoding_table
from .path_slopes import Looked, sampled, slopes_along
from .path_step_kernels import slope_rows
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


def _in_one_pass(looked: Looked, basis: Tensor) -> Along | None:
    """By a compiled kernel, where all is in memory and the frames' light meets no other effect."""
    exposed, at, frames = looked.exposed, looked.at, looked.whole
    columns = basis.dim() == 4 and basis.shape[-1] > 1
    if exposed.together is not None or columns or frames.device.type != "cpu" or frames.dtype != torch.float32:
        return None
    seen = at.of_planes(exposed.degraded)
    _, height, width = seen.shape
    shares = basis[:, :, None] if basis.dim() == 2 else sampled(exposed, basis, at)[..., 0]
    shares = shares.float().expand(-1, -1, height).contiguous()
    slopes = torch.empty((2 * len(basis), 3, height, width))
    right, down, by_curve = slopes[: len(basis)], slopes[len(basis) :], torch.empty((2, 3, height, width))
    where = np.array([at.rows.start, at.columns.start, at.rows.step, exposed.shot.margin], np.int64)
    run(
        slope_rows,
        3 * height,
        *(planes.contiguous().numpy() for planes in (frames, exposed.degraded)),
        where,
        shares.numpy(),
        np.array([looked.curve.toe, looked.curve.shoulder], np.float32),
        decoding_table(),
        *(planes.numpy() for planes in (right, down, by_curve)),
        grain=8,
    )
    return Along(right, down, by_curve)
