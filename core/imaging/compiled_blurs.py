"""Ways to evaluate one blur in compiled code on the CPU: separable and direct; see `evaluations`."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..compiled import run
from ..constants import TILE
from ..frames import Frame
from .blur_kernels import correlate, correlate_rows, separable_adjoint, separable_apply
from .evaluations import blur_matrix, extended, folded

#: Blocks of 16 rows that are worth a call to a thread; changes the time only, not the result.
_GRAIN = 4

Array = NDArray[np.float64]


def _numpy(tensor: Tensor) -> NDArray[np.floating]:
    return tensor.detach().contiguous().numpy()


class Separable:
    """Vertical and horizontal taps for kernels that are symmetric along each axis.

    In compiled code for float32 and at least 16 columns; else as products of banded matrices.
    """

    name = "separable"

    def __init__(self, vertical: Array, horizontal: Array, frame: Frame, dtype: torch.dtype) -> None:
        self.frame = frame
        self.half_v, self.half_h = (t[t.size // 2 :].astype(np.float32) for t in (vertical, horizontal))
        self.matrices: tuple[Tensor, Tensor] | None = None
        if dtype != torch.float32 or frame.width < TILE:
            down = torch.from_numpy(blur_matrix(vertical, frame.height, frame.margin))
            across = torch.from_numpy(blur_matrix(horizontal, frame.width, frame.margin))
            self.matrices = down.to(dtype), across.to(dtype)

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        if self.matrices is not None:
            return self.matrices[0] @ frame @ self.matrices[1].T
        f = self.frame
        out = torch.empty((frame.shape[0], f.height, f.width), dtype=frame.dtype)
        arguments = (_numpy(frame), out.numpy(), self.half_v, self.half_h, f.margin)
        run(separable_apply, frame.shape[0] * -(-f.height // TILE), *arguments, grain=_GRAIN)
        return out

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        if self.matrices is not None:
            return self.matrices[0].T @ photo @ self.matrices[1]
        f = self.frame
        out = torch.empty((photo.shape[0], *f.rendered), dtype=photo.dtype)
        arguments = (_numpy(photo), out.numpy(), self.half_v, self.half_h, f.margin)
        run(separable_adjoint, photo.shape[0] * -(-f.rendered[0] // TILE), *arguments, grain=_GRAIN)
        return out


class Direct:
    """Every tap of a two-dimensional kernel, in compiled code."""

    name = "direct"

    def __init__(self, kernel: Array, frame: Frame, dtype: torch.dtype) -> None:
        self.frame = frame
        self.radius = kernel.shape[0] // 2, kernel.shape[1] // 2
        self.forward = self._taps(kernel[::-1, ::-1], dtype)  # a convolution correlates with the mirrored kernel
        self.backward = self._taps(kernel, dtype)

    @staticmethod
    def _taps(kernel: Array, dtype: torch.dtype) -> NDArray[np.floating]:
        padded = np.pad(kernel, ((0, 0), (0, -kernel.shape[1] % 4)))
        return padded.astype(np.float32 if dtype == torch.float32 else np.float64)

    def _correlated(self, source: Tensor, taps: NDArray[np.floating], height: int, width: int) -> Tensor:
        source = torch.nn.functional.pad(source, (0, width + taps.shape[1] - 1 - source.shape[2]))
        out = torch.empty((source.shape[0], height, width), dtype=source.dtype)
        run(correlate, source.shape[0] * height, _numpy(source), out.numpy(), taps, grain=4)
        return out

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        rv, rh = (r - self.frame.margin for r in self.radius)
        return self._correlated(extended(frame, rv, rh), self.forward, self.frame.height, self.frame.width)

    def apply_rows(self, frame: Tensor, rows: range) -> Tensor:
        """[C, R, W] some rows of `apply(frame)`, in their share of its time."""
        rv, rh = (r - self.frame.margin for r in self.radius)
        source = extended(frame, rv, rh)
        source = torch.nn.functional.pad(source, (0, self.frame.width + self.forward.shape[1] - 1 - source.shape[2]))
        out = torch.empty((source.shape[0], len(rows), self.frame.width), dtype=source.dtype)
        arguments = (_numpy(source), out.numpy(), self.forward, rows.start, rows.step)
        run(correlate_rows, source.shape[0] * len(rows), *arguments, grain=4)
        return out

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        (rv, rh), f = self.radius, self.frame
        embedded = torch.nn.functional.pad(photo, (2 * rh, 2 * rh, 2 * rv, 2 * rv))
        spread = self._correlated(embedded, self.backward, f.height + 2 * rv, f.width + 2 * rh)
        return folded(spread, rv - f.margin, rh - f.margin).contiguous()
