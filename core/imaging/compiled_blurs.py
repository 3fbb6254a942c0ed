"""Ways to evaluate one blur in compiled code on the CPU: separable, direct and by runs; see `evaluations`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..compiled import run
from ..constants import TILE
from ..frames import Frame
from .blur_kernels import correlate, correlate_rows, separable_adjoint, separable_apply
from .evaluations import blur_matrix, extended, folded
from .run_kernels import BLOCK, CELL, add_up, lay_out

#: Blocks of 16 rows that are worth a call to a thread; changes the time only, not the result.
_GRAIN = 4
#: Rows of one channel that are.
_ROWS = 16

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


@dataclass(frozen=True)
class KernelRows:
    """Rows of a kernel as weighted reads, see `add_up`.

    Attributes:
        starts: [K + 1] of each row's reads.
        offsets: of reads, bytes from the first float of a laid-out row; weights: of reads.
        reach: columns of the kernel, less one.
    """

    starts: NDArray[np.int64]
    offsets: NDArray[np.int64]
    weights: NDArray[np.float32]
    reach: int

    @staticmethod
    def of(kernel: Array, length: int) -> KernelRows:
        """Of each row the longest run of equal taps is two reads of sums, and the others are a read each.

        Args:
            length: px of a laid-out row.
        """
        starts: list[int] = [0]
        reads: list[tuple[int, float]] = []
        for row in kernel:
            begin, end = _longest_run(row)
            if end - begin <= 2:
                begin = end = 0
            else:
                reads += [(length + end, row[begin]), (length + begin, -row[begin])]
            reads += [(int(i), row[i]) for i in np.flatnonzero(row) if not begin <= i < end]
            starts.append(len(reads))
        offsets, weights = zip(*reads, strict=True)
        whole = np.array(starts, np.int64), 4 * np.array(offsets, np.int64)
        return KernelRows(*whole, np.array(weights, np.float32), kernel.shape[1] - 1)


def reads_by_runs(kernel: Array) -> float:
    """Reads that a kernel takes by runs, as a share of its taps."""
    return len(KernelRows.of(kernel, 0).weights) / int(np.count_nonzero(kernel))


def _longest_run(row: Array) -> tuple[int, int]:
    """Begin and end of the longest stretch of equal taps that are not zero."""
    ends = np.flatnonzero(np.diff(row, append=np.nan) != 0) + 1
    begins = np.concatenate([[0], ends[:-1]])
    lengths = np.where(row[begins] != 0, ends - begins, 0)
    longest = int(lengths.argmax())
    return int(begins[longest]), int(begins[longest] + lengths[longest])


class Runs:
    """A two-dimensional kernel whose rows hold long runs of equal taps, as a disk's; float32, at least 64 columns.

    Where a frame holds nothing but zeros, as one of what lies at some depth does nearly everywhere, nothing is done.
    """

    name = "runs"

    def __init__(self, kernel: Array, frame: Frame) -> None:
        self.frame = frame
        self.radius = kernel.shape[0] // 2, kernel.shape[1] // 2
        rh = self.radius[1]
        self._lengths = frame.width + 2 * rh, frame.width + 4 * rh
        self.forward = KernelRows.of(kernel[::-1, ::-1], self._lengths[0])
        self.backward = KernelRows.of(kernel, self._lengths[1])

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        return self.apply_rows(frame, range(self.frame.height))

    def apply_rows(self, frame: Tensor, rows: range) -> Tensor:
        """[C, R, W] some rows of `apply(frame)`, in little more than their share of its time."""
        f, (rv, rh) = self.frame, self.radius
        larger = f.height + 2 * rv, self._lengths[0]
        shift = rv - f.margin, rh - f.margin
        wanted = np.ones((len(rows), -(-f.width // BLOCK)), np.uint8)
        return _added(frame, (shift, True, larger), self.forward, rows, f.width, wanted)

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        f = self.frame
        return self.adjoint_at(photo, torch.ones(f.rendered, dtype=torch.bool))

    def adjoint_at(self, photo: Tensor, wanted: Tensor) -> Tensor:
        """The transpose where `wanted` [H + 2m, W + 2m] is true; elsewhere it may be anything."""
        f, (rv, rh) = self.frame, self.radius
        larger = f.height + 4 * rv, self._lengths[1]
        rows, width = range(f.height + 2 * rv), f.width + 2 * rh
        shift = 2 * rv, 2 * rh
        spread = _added(photo, (shift, False, larger), self.backward, rows, width, self._blocks(wanted))
        return folded(spread, rv - f.margin, rh - f.margin).contiguous()

    def _blocks(self, wanted: Tensor) -> NDArray[np.uint8]:
        """[H + 2r, blocks] which of the larger frame, that beyond the margin folds back, are wanted."""
        rv, rh = (r - self.frame.margin for r in self.radius)
        there = wanted.numpy()
        rows = np.clip(np.arange(-rv, there.shape[0] + rv), 0, there.shape[0] - 1)
        width = there.shape[1] + 2 * rh
        count = -(-width // BLOCK)
        lefts = np.minimum(np.arange(count) * BLOCK, width - BLOCK)
        found = np.zeros((there.shape[0], count), np.uint8)
        for block, left in enumerate(lefts):
            first, last = (min(max(x - rh, 0), there.shape[1] - 1) for x in (left, left + BLOCK - 1))
            found[:, block] = there[:, first : last + 1].any(axis=1)
        return found[rows]


def _added(
    source: Tensor,
    layout: tuple[tuple[int, int], bool, tuple[int, int]],
    kernel: KernelRows,
    rows: range,
    width: int,
    wanted: NDArray[np.uint8],
) -> Tensor:
    """[C, R, width] `add_up` of a source; layout: shift, whether its edge is repeated, and size of what is laid out."""
    shift, repeats, (height, length) = layout
    channels = source.shape[0]
    lines = np.empty((channels, height, 2 * length + 1), np.float32)
    filled = np.empty((channels, height, -(-length // CELL) + 1), np.int32)
    run(lay_out, channels * height, _numpy(source), shift, repeats, lines, filled, grain=_ROWS)
    out = torch.empty((channels, len(rows), width))
    tables = np.empty((channels * len(rows), 2, len(kernel.starts) - 1), np.int64)
    taps = kernel.starts, kernel.offsets, kernel.weights
    arguments = (lines, filled, kernel.reach, taps, (rows.start, rows.step), wanted, tables, out.numpy())
    run(add_up, channels * len(rows), *arguments, grain=4)
    return out
