"""Frames that are larger than their photo, and linear maps between the two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor


@dataclass(frozen=True)
class Frame:
    """Sizes: the photo is height x width px, the rendered frame has `margin` px more on each side."""

    height: int
    width: int
    margin: int

    @property
    def rendered(self) -> tuple[int, int]:
        """[2] height and width of the frames that are rendered, margin included."""
        return self.height + 2 * self.margin, self.width + 2 * self.margin


class Evaluation(Protocol):
    """A linear map and its transpose."""

    name: str

    def apply(self, frame: Tensor) -> Tensor: ...

    def adjoint(self, photo: Tensor) -> Tensor: ...


@runtime_checkable
class RowEvaluation(Protocol):
    """An evaluation that computes each row of the photo by itself."""

    def apply_rows(self, frame: Tensor, rows: range) -> Tensor:
        """[C, R, W] some rows of `Evaluation.apply`."""
        ...


@runtime_checkable
class PartialAdjoint(Protocol):
    """An evaluation whose transpose costs less where only a part of it is wanted."""

    def adjoint_at(self, photo: Tensor, wanted: Tensor) -> Tensor:
        """`Evaluation.adjoint` where `wanted` [H + 2m, W + 2m] is true; elsewhere it may be anything."""
        ...


def in_a_row(tensors: Sequence[Tensor]) -> Tensor:
    """[K, ...] of K tensors of one shape; no copy where they lie one behind the other, as parts of one tensor do."""
    first, size = tensors[0], tensors[0].numel()
    place = first.storage_offset()
    if first.device.type != "cpu" or any(
        tensor.shape != first.shape
        or not tensor.is_contiguous()
        or tensor.untyped_storage().data_ptr() != first.untyped_storage().data_ptr()
        or tensor.storage_offset() != place + k * size
        for k, tensor in enumerate(tensors)
    ):
        return torch.stack(list(tensors))
    return first.as_strided((len(tensors), *first.shape), (size, *first.stride()))
