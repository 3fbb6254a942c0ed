"""Blurs on the card; specified in `core.imaging` (`evaluations`, `compiled_blurs`)."""

from __future__ import annotations

import struct
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ...frames import Frame
from ...imaging.evaluations import folded
from .card import Memory, card
from .layout import GROUP
from .tensors import CardTensor, empty, for_shader, written


def _on_card(values: NDArray[np.float64]) -> Memory:
    memory = card().memory(4 * values.size)
    card().write(memory, values.astype(np.float32))
    return memory


class SeparableOnCard:
    """Vertical and horizontal taps of a kernel that is symmetric along each axis; see `core.frames.Evaluation`.

    Args:
        vertical, horizontal: odd numbers of taps.
    """

    name = "separable"

    def __init__(self, vertical: NDArray[np.float64], horizontal: NDArray[np.float64], frame: Frame) -> None:
        self.frame, self._taps = frame, (vertical, horizontal)

    @cached_property
    def _memories(self) -> list[tuple[Memory, int]]:
        """Of each axis the taps from the middle on with their sums from each on outwards, and its radius in px."""
        found = []
        for taps in self._taps:
            half = taps[taps.size // 2 :]
            found.append((_on_card(np.concatenate([half, np.cumsum(half[::-1])[::-1]])), half.size - 1))
        return found

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        height, width = self.frame.height, self.frame.width
        return self._along(1, self._along(0, frame, height, False), width, False)

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        height, width = self.frame.rendered
        return self._along(1, self._along(0, photo, height, True), width, True)

    def _along(self, axis: int, source: Tensor, length: int, transposed: bool) -> CardTensor:
        """One axis of it: 0 for columns, 1 for rows; `length` is the result's."""
        taps, radius = self._memories[axis]
        planes, height, width = source.shape
        made = empty(planes, length, width) if axis == 0 else empty(planes, height, length)
        inner, before = (width, height) if axis == 0 else (1, width)
        numbers = struct.pack("4I2iI", made.numel(), inner, length, before, self.frame.margin, radius, int(transposed))
        memories = taps, for_shader(source), made.held.for_card(overwrite=True)
        card().for_each("blur", made.numel(), GROUP, numbers, *memories)
        return written(made)


class DirectOnCard:
    """Every tap of a two-dimensional kernel [K, L]; see `core.frames.Evaluation`."""

    name = "direct"

    def __init__(self, kernel: NDArray[np.float64], frame: Frame) -> None:
        self.frame, self._kernel = frame, kernel
        self.radius = kernel.shape[0] // 2, kernel.shape[1] // 2

    @cached_property
    def _forward(self) -> Memory:
        return _on_card(self._kernel[::-1, ::-1])  # a convolution correlates with the mirrored kernel

    @cached_property
    def _backward(self) -> Memory:
        return _on_card(self._kernel)

    def apply(self, frame: Tensor) -> Tensor:
        """The blur of a frame [C, H + 2m, W + 2m] -> [C, H, W]."""
        f = self.frame
        before = self.radius[0] - f.margin, self.radius[1] - f.margin
        return self._correlated(frame, self._forward, (f.height, f.width), before, True)

    def adjoint(self, photo: Tensor) -> Tensor:
        """Its transpose, [C, H, W] -> [C, H + 2m, W + 2m]."""
        (rv, rh), f = self.radius, self.frame
        size = f.height + 2 * rv, f.width + 2 * rh
        spread = self._correlated(photo, self._backward, size, (2 * rv, 2 * rh), False)
        return folded(spread, rv - f.margin, rh - f.margin).contiguous()

    def _correlated(
        self, source: Tensor, taps: Memory, size: tuple[int, int], before: tuple[int, int], repeated: bool
    ) -> CardTensor:
        """[C, *size]; `before`: rows and columns that the first tap lies before the source's first value."""
        made = empty(source.shape[0], *size)
        table = size[1], size[0], made.numel(), int(repeated), source.shape[2], source.shape[1]
        numbers = struct.pack("6I4i", *table, before[1], before[0], self._kernel.shape[1], self._kernel.shape[0])
        memories = taps, for_shader(source), made.held.for_card(overwrite=True)
        card().for_each("correlate", made.numel(), GROUP, numbers, *memories)
        return written(made)


def blurs_on_card(
    kernel: NDArray[np.float64], taps: tuple[NDArray, NDArray] | None, frame: Frame, most_taps: int
) -> dict[str, SeparableOnCard | DirectOnCard]:
    """See `core.devices.Backend.blurs`, float32; a kernel of more than `most_taps` is not evaluated tap by tap."""
    found: dict[str, SeparableOnCard | DirectOnCard] = {}
    if kernel.size <= most_taps:
        found["direct"] = DirectOnCard(kernel, frame)
    if taps is not None:
        found["separable"] = SeparableOnCard(*taps, frame)
    return found
