"""The few operations of torch between the shaders of a training step, on the card: sums, products, zeros."""

from __future__ import annotations

import struct
from typing import Any

import torch
from torch import Tensor

from .card import card
from .layout import GROUP, PRODUCT, SCALED, SUM
from .tensors import CardTensor, Values, empty, for_shader, in_place, on_card, written

_aten = torch.ops.aten


def _is_whole(tensor: Any) -> bool:
    """Whether a tensor's values lie on the card, all of them and in their order."""
    return (
        isinstance(tensor, CardTensor)
        and tensor.held.on_card
        and tensor.dtype == torch.float32
        and tensor.is_contiguous()
        and not tensor.storage_offset()
        and tensor.numel() > 0
    )


def _fits(tensor: Tensor, other: Any) -> bool:
    return isinstance(other, CardTensor) and other.dtype == torch.float32 and other.shape == tensor.shape


def _made(operation: int, a: Tensor, b: Tensor, scale: float = 1.0, shift: float = 0.0) -> CardTensor:
    made = empty(*a.shape)
    numbers = struct.pack("2I2f", a.numel(), operation, scale, shift)
    memories = for_shader(a), for_shader(b), made.held.for_card(overwrite=True)
    card().for_each("elementwise", a.numel(), GROUP, numbers, *memories)
    return written(made)


@on_card(_aten.mul.Tensor, _aten.mul.Scalar)
def _product(a: Any, b: Any) -> Any:
    if not _is_whole(a):
        return NotImplemented
    if isinstance(b, float | int):
        return _made(SCALED, a, a, float(b))
    return _made(PRODUCT, a, b) if _fits(a, b) else NotImplemented


@on_card(_aten.add.Tensor, _aten.add.Scalar)
def _sum(a: Any, b: Any, alpha: float = 1) -> Any:
    if not _is_whole(a):
        return NotImplemented
    if isinstance(b, float | int):
        return _made(SCALED, a, a, 1.0, float(alpha * b))
    return _made(SUM, a, b, float(alpha)) if _fits(a, b) else NotImplemented


@on_card(_aten.sub.Tensor, _aten.sub.Scalar)
def _difference(a: Any, b: Any, alpha: float = 1) -> Any:
    return _sum(a, b, -alpha)


@on_card(_aten.rsub.Scalar)
def _reversed_difference(a: Any, b: float, alpha: float = 1) -> Any:
    return _made(SCALED, a, a, -float(alpha), float(b)) if _is_whole(a) else NotImplemented


@on_card(_aten.add_.Tensor)
def _add_in_place(a: Any, b: Any, alpha: float = 1) -> Any:
    if not _is_whole(a) or not _fits(a, b):
        return NotImplemented
    numbers = struct.pack("If", a.numel(), float(alpha))
    card().for_each("add_in_place", a.numel(), GROUP, numbers, for_shader(b), in_place(a))
    return a


@on_card(_aten.zeros_like.default)
def _zeros_like(tensor: Any, **options: Any) -> Any:
    """In both places at once: neither has to be brought to the other."""
    if not isinstance(tensor, CardTensor) or options.get("dtype") not in (None, torch.float32) or not tensor.numel():
        return NotImplemented
    if tensor.dtype != torch.float32 or options.get("device") not in (None, tensor.device):
        return NotImplemented
    local = torch.zeros(tensor.shape)
    memory = card().memory(4 * local.numel())
    card().clear(memory)
    return CardTensor(local, Values(local.reshape(-1), memory, on_host=True))
