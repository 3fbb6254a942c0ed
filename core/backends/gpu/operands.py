"""Tensors as shaders see them: numbers in the card's memory at steps along up to four axes, broadcast as torch does."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import prod
from typing import Any

import torch
from torch import Tensor

from .card import Memory, card
from .layout import A_BYTES, A_NUMBER, AXES, B_BYTES, B_NUMBER, GROUP, IN_PLACE
from .tensors import CardTensor, Values, from_host

#: What shaders compute with; truth values are bytes, complex numbers pairs.
_KINDS = (torch.float32, torch.bool, torch.complex64)


@dataclass(frozen=True)
class Operand:
    """Values at steps, from an offset on; counted in single numbers (bytes of truth values)."""

    held: Values
    shape: tuple[int, ...]
    steps: tuple[int, ...]
    offset: int
    bytes: bool = False


def belongs_on_card(*tensors: Any) -> bool:
    """Whether an operation on these is the card's: all lie there, or one of them lies nowhere else.

    What was brought to the computer's memory once stays there with all that is made of it: values do not go to and fro.
    """
    mine = [tensor for tensor in tensors if isinstance(tensor, CardTensor)]
    if not mine or any(t.dtype not in _KINDS or not t.numel() for t in mine):
        return False
    return any(t.held.only_on_card for t in mine) or all(t.held.on_card for t in mine)


def operand(tensor: Tensor, pairs: bool = False) -> Operand:
    """A tensor as shaders see it; with `pairs` along one more axis, of a complex number's two parts."""
    seen = tensor if isinstance(tensor, CardTensor) else from_host(tensor)
    local = seen.local
    shape, steps, offset = tuple(local.shape), tuple(local.stride()), int(local.storage_offset())
    if local.is_complex():
        shape, steps, offset = (*shape, 2), (*(2 * step for step in steps), 1), 2 * offset
    elif pairs:
        shape, steps = (*shape, 2), (*steps, 0)
    return Operand(seen.held, shape, steps, offset, local.dtype == torch.bool)


def single_numbers(one: Operand) -> Operand:
    """The pairs of a complex tensor as single places, at its real parts."""
    return Operand(one.held, one.shape[:-1], one.steps[:-1], one.offset)


def _broadcast(one: Operand, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Its steps along the axes of `shape`."""
    lead = len(shape) - len(one.shape)
    sizes, steps = (1,) * lead + one.shape, (0,) * lead + one.steps
    return tuple(0 if size == 1 else step for size, step in zip(sizes, steps, strict=True))


def _merged(shape: Sequence[int], tables: Sequence[Sequence[int]]) -> tuple[list[int], list[list[int]]]:
    """The same places with fewer axes: those of one value left out, those that follow each other joined."""
    sizes: list[int] = []
    steps: list[list[int]] = [[] for _ in tables]
    for axis, size in enumerate(shape):
        if size == 1:
            continue
        now = [table[axis] for table in tables]
        if sizes and all(row[-1] == step * size for row, step in zip(steps, now, strict=True)):
            sizes[-1] *= size
            for row, step in zip(steps, now, strict=True):
                row[-1] = step
        else:
            sizes.append(size)
            for row, step in zip(steps, now, strict=True):
                row.append(step)
    return sizes, steps


def order(
    kernel: str,
    operation: int,
    shape: tuple[int, ...],
    operands: Sequence[Operand | float | None],
    out: Operand,
    numbers: tuple[float, float] = (0.0, 0.0),
    flags: int = 0,
) -> bool:
    """Orders a shader of `operands.wgsl`; False where tensors have too many axes for it.

    Args:
        operands: a, b and c: tensors, plain numbers, or None. out: the result, of `shape`; truth values are made four
            by a thread.
    """
    nothing = Operand(out.held, (), (), 0)
    seen = [one if isinstance(one, Operand) else nothing for one in operands]
    sizes, tables = _merged(shape, [_broadcast(one, shape) for one in (*seen, out)])
    if len(sizes) > AXES:
        return False
    plain = [float(one) if isinstance(one, float | int) else 0.0 for one in operands[:2]]
    flags |= sum(
        flag
        for one, is_number, is_bytes in zip(operands, (A_NUMBER, B_NUMBER), (A_BYTES, B_BYTES), strict=False)
        for flag in _flags(one, is_number, is_bytes)
    )
    memories = [
        one.held.for_card() if isinstance(one, Operand) and not (flags & IN_PLACE and place == 0) else unused()
        for place, one in enumerate(operands)
    ]
    packed = _packed(sizes, tables, [*(one.offset for one in seen), out.offset], (*plain, *numbers))
    count = prod(shape)
    target = out.held.for_card(overwrite=not flags & IN_PLACE and count == out.held.host.numel())
    ending = struct.pack("3I", count, operation, flags)
    card().for_each(kernel, count, GROUP * (4 if out.bytes else 1), packed + ending, *memories, target)
    out.held.changed_on_card()
    return True


def _flags(one: Operand | float | None, is_number: int, is_bytes: int) -> Sequence[int]:
    if not isinstance(one, Operand):
        return (is_number,)
    return (is_bytes,) if one.bytes else ()


def _packed(sizes: list[int], tables: list[list[int]], offsets: list[int], numbers: tuple[float, ...]) -> bytes:
    lack = AXES - len(sizes)
    rows = [[1] * lack + sizes, *([0] * lack + steps for steps in tables), offsets]
    return struct.pack(f"{AXES * len(rows)}I", *(n for row in rows for n in row)) + struct.pack("4f", *numbers)


@cache
def unused() -> Memory:
    """What a shader binds where it reads nothing."""
    return card().memory(4)
