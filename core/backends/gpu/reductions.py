"""Torch's sums, lengths and products of matrices along axes, on the card, in float32 (sums of complex numbers, too)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import prod
from typing import Any

import torch

from .card import card
from .layout import AXES, GROUP, LARGER, ROOT, SUM
from .operands import belongs_on_card, operand
from .tensors import CardTensor, empty, from_host, on_card, written

_aten = torch.ops.aten


def _suits(a: Any, kinds: tuple[torch.dtype, ...] = (torch.float32,)) -> bool:
    return isinstance(a, CardTensor) and a.dtype in kinds and not a.local.is_conj() and belongs_on_card(a)


def _without(values: tuple[int, ...], axis: int) -> tuple[int, ...]:
    return values[:axis] + values[axis + 1 :]


def _along(operation: int, a: CardTensor, axis: int, factor: float) -> CardTensor:
    """Along one axis, which is gone from the result."""
    seen, axis = operand(a), axis % a.ndim
    made = empty(*_without(tuple(a.shape), axis), dtype=a.dtype)
    sizes, steps = _without(seen.shape, axis), _without(seen.steps, axis)
    lack = AXES - len(sizes)
    table = (*([1] * lack), *sizes, *([0] * lack), *steps, seen.offset, seen.shape[axis], seen.steps[axis])
    count = prod(sizes)
    numbers = struct.pack(f"{2 * AXES + 3}I2If", *table, count, operation, factor)
    into = made.held.for_card(overwrite=True)
    card().for_each("reduce", count, GROUP, numbers, seen.held.for_card(), into)
    return written(made)


def _reduced(operation: int, a: Any, axes: Any, keep: bool, factor: float = 1.0) -> Any:
    """Along axes, the last one first; NotImplemented for a row of values, whose sum is no work for one thread."""
    if a.ndim - 1 > AXES - int(a.is_complex()):
        return NotImplemented
    every = range(a.ndim) if not axes else sorted({axis % a.ndim for axis in axes})
    if len(every) == a.ndim == 1:
        return NotImplemented
    found = a
    for place, axis in enumerate(reversed(every)):
        found = _along(operation, found, axis, factor if place == 0 else 1.0)
        found = found.unsqueeze(axis) if keep else found
    return found


@on_card(_aten.sum.dim_IntList)
def _sum(a: Any, axes: Sequence[int] | None, keep: bool = False, *, dtype: Any = None) -> Any:
    suits = dtype in (None, a.dtype) and _suits(a, (torch.float32, torch.complex64))
    return _reduced(SUM, a, axes, keep) if suits else NotImplemented


@on_card(_aten.sum.default)
def _total(a: Any, *, dtype: Any = None) -> Any:
    return _sum(a, None, dtype=dtype) if a.ndim else NotImplemented


@on_card(_aten.mean.dim)
def _mean(a: Any, axes: Sequence[int] | None, keep: bool = False, *, dtype: Any = None) -> Any:
    if dtype not in (None, torch.float32) or not _suits(a):
        return NotImplemented
    every = axes if axes else range(a.ndim)
    return _reduced(SUM, a, axes, keep, 1.0 / prod(a.shape[axis] for axis in every))


@on_card(_aten.mean.default)
def _mean_of_all(a: Any, *, dtype: Any = None) -> Any:
    return _mean(a, None, dtype=dtype) if a.ndim else NotImplemented


@on_card(_aten.linalg_vector_norm.default)
def _lengths(a: Any, power: float = 2, axes: Any = None, keep: bool = False, *, dtype: Any = None) -> Any:
    if power != 2 or not axes or len(axes) != 1 or dtype is not None or not _suits(a):
        return NotImplemented
    return _reduced(ROOT, a, axes, keep)


@on_card(_aten.amax.default)
def _largest(a: Any, axes: Any = (), keep: bool = False) -> Any:
    return _reduced(LARGER, a, axes, keep) if axes and _suits(a) else NotImplemented


@on_card(_aten.aminmax.default)
def _extremes(a: Any, *, dim: int | None = None, keepdim: bool = False) -> Any:
    """The least and the largest of all values; of the last axis' worth of them in the computer's memory."""
    if dim is not None or a.ndim < 2 or not _suits(a):
        return NotImplemented
    others = tuple(range(a.ndim - 1))
    rows: Any = torch.stack([_reduced(LARGER, one, others, False) for one in (-a, a)])
    rows.held.for_host()
    ends = rows.local.amax(dim=1)
    return from_host(-ends[0]), from_host(ends[1])


@on_card(_aten.mm.default, _aten.bmm.default)
def _matrices(a: Any, b: Any) -> Any:
    """[N, R, K] @ [N, K, C], or without N."""
    if not all(isinstance(one, CardTensor) and one.dtype == torch.float32 for one in (a, b)):
        return NotImplemented
    if not belongs_on_card(a, b):
        return NotImplemented
    planes = a.shape[0] if a.ndim == 3 else 1
    made = empty(*a.shape[:-1], b.shape[-1])
    seen = [operand(one) for one in (a, b)]
    steps = [(0, *one.steps)[-3:] for one in seen]
    table = [planes, a.shape[-2], b.shape[-1], a.shape[-1]]
    for step, one in zip(steps, seen, strict=True):
        table += [*step, one.offset]
    memories = (*(one.held.for_card() for one in seen), made.held.for_card(overwrite=True))
    card().for_each("matrices", made.numel(), GROUP, struct.pack("12I", *table), *memories)
    return written(made)
