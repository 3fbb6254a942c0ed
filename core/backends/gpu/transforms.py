"""Fourier transforms of images and frames grown at their borders, on the card, as torch's own operations.

A transform is a row of passes, one for each factor of its length (Stockham's way, which needs no other order of its
values): in the memory of a group of threads where whole lines fit into it, else each over the card's memory. Lengths
are products of 2, 3, 4 and 5, as `scipy.fft.next_fast_len` chooses them. Others are torch's work in the computer's
memory.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch

from .card import Memory, card
from .layout import GROUP, HALF, LINE_VALUES, REAL, WHOLE
from .operands import belongs_on_card
from .radices import factors, lines_of_group
from .tensors import CardTensor, empty, for_shader, on_card, written

_aten = torch.ops.aten
#: Lengths whose table of turns is kept on the card.
_LENGTHS_KEPT = 32


@lru_cache(maxsize=_LENGTHS_KEPT)
def _turns(length: int) -> Memory:
    """[length] exp(-2 pi i k / length)."""
    memory = card().memory(8 * length)
    card().write(memory, np.exp(-2j * np.pi * np.arange(length) / length).astype(np.complex64))
    return memory


@dataclass(frozen=True)
class _Axis:
    """Lines along one axis.

    Attributes:
        length: of the transform; inner: lines that lie side by side; outer: groups of them.
        pitches: values between two groups in source, between passes, and in the result.
        kinds: of source and result; scale: of the result.
    """

    length: int
    inner: int
    outer: int
    pitches: tuple[int, int, int]
    kinds: tuple[int, int]
    inverse: bool
    scale: float = 1.0


def _transformed(axis: _Axis, source: Memory, target: Memory) -> None:
    """Transforms all lines."""
    radices = factors(axis.length)
    assert radices is not None
    if axis.length <= LINE_VALUES:
        _in_groups(axis, source, target)
    else:
        _in_passes(axis, radices, source, target)


def _in_groups(axis: _Axis, source: Memory, target: Memory) -> None:
    """One order: each group transforms as many lines as its memory holds."""
    count, pitches = axis.inner * axis.outer, (axis.pitches[0], axis.pitches[2])
    numbers = struct.pack("7If", axis.inner, count, *pitches, *axis.kinds, int(axis.inverse), axis.scale)
    memories = _turns(axis.length), source, target
    card().for_each(f"transform_lines/{axis.length}", count, lines_of_group(axis.length), numbers, *memories)


def _in_passes(axis: _Axis, radices: tuple[int, ...], source: Memory, target: Memory) -> None:
    """An order for each factor; in between, the values lie in memory of their own."""
    done, count = 1, axis.inner * axis.outer
    spare = [card().memory(8 * axis.length * count) for _ in radices[1:3]]
    for place, radix in enumerate(radices):
        first, last = place == 0, place == len(radices) - 1
        into = target if last else spare[place % len(spare)]
        pitches = axis.pitches[0 if first else 1], axis.pitches[2 if last else 1]
        kinds = axis.kinds[0] if first else WHOLE, axis.kinds[1] if last else WHOLE
        butterflies = count * (axis.length // radix)
        table = (axis.length, radix, done, axis.inner, butterflies, *pitches, *kinds, int(axis.inverse))
        numbers = struct.pack("10If", *table, axis.scale if last else 1.0)
        card().for_each("transform", butterflies, GROUP, numbers, _turns(axis.length), source, into)
        source, done = into, done * radix


def _scale(norm: int, values: int) -> float:
    """Torch's numbers for none, 1 / sqrt(n) and 1 / n."""
    return (1.0, values**-0.5, 1.0 / values)[norm]


def _suits(a: Any, axes: Sequence[int], kind: torch.dtype, size: tuple[int, int]) -> bool:
    """Whether the last two axes are transformed, of tensors on the card, and lengths have small factors."""
    if not isinstance(a, CardTensor) or a.dtype != kind or a.local.is_conj() or not belongs_on_card(a):
        return False
    last_two = a.ndim >= 2 and [axis % a.ndim for axis in axes] == [a.ndim - 2, a.ndim - 1]
    return last_two and all(factors(length) is not None for length in size)


@on_card(_aten._fft_r2c.default)
def _spectrum(a: Any, axes: Sequence[int], norm: int, onesided: bool) -> Any:
    """Of real images [..., h, w]: [..., h, w // 2 + 1] complex."""
    height, width = a.shape[-2:] if a.ndim >= 2 else (0, 0)
    if not onesided or not _suits(a, axes, torch.float32, (height, width)):
        return NotImplemented
    half, planes = width // 2 + 1, a.numel() // (height * width)
    rows = card().memory(8 * planes * height * half)
    along = _Axis(width, 1, planes * height, (width, width, half), (REAL, HALF), False)
    _transformed(along, for_shader(a), rows)
    made = empty(*a.shape[:-1], half, dtype=torch.complex64)
    pitch = height * half
    down = _Axis(height, half, planes, (pitch,) * 3, (WHOLE, WHOLE), False, _scale(norm, height * width))
    _transformed(down, rows, made.held.for_card(overwrite=True))
    return written(made)


@on_card(_aten._fft_c2r.default)
def _image(a: Any, axes: Sequence[int], norm: int, width: int) -> Any:
    """Real images [..., h, w] of spectra [..., h, w // 2 + 1]."""
    height, half = a.shape[-2:] if a.ndim >= 2 else (0, 0)
    if half != width // 2 + 1 or not _suits(a, axes, torch.complex64, (height, width)):
        return NotImplemented
    whole = a if a.is_contiguous() and not a.storage_offset() else a.clone(memory_format=torch.contiguous_format)
    assert isinstance(whole, CardTensor)
    planes, pitch = a.numel() // (height * half), height * half
    columns = card().memory(8 * a.numel())
    down = _Axis(height, half, planes, (pitch,) * 3, (WHOLE, WHOLE), True)
    _transformed(down, whole.held.for_card(), columns)
    made = empty(*a.shape[:-1], width)
    along = _Axis(width, 1, planes * height, (half, width, width), (HALF, REAL), True, _scale(norm, height * width))
    _transformed(along, columns, made.held.for_card(overwrite=True))
    return written(made)


def padded(a: CardTensor, sides: Sequence[int], beyond: float | None) -> CardTensor:
    """[..., h, w] with px more (or fewer) left, right, top and bottom; `beyond` stands there, or the edge if None."""
    left, right, top, bottom = (*sides, 0, 0)[:4]
    rows, columns = a.shape[-2:]
    height, width = rows + top + bottom, columns + left + right
    made = empty(*a.shape[:-2], height, width)
    table = width, height, made.numel(), int(beyond is None), columns, rows, left, top
    numbers = struct.pack("6I2if", *table, beyond or 0.0)
    card().for_each("pad", made.numel(), GROUP, numbers, for_shader(a), made.held.for_card(overwrite=True))
    return written(made)


@on_card(_aten.constant_pad_nd.default)
def _padded_by_number(a: Any, sides: Sequence[int], value: float = 0) -> Any:
    suits = isinstance(a, CardTensor) and a.dtype == torch.float32 and a.ndim >= 2 and not any(sides[4:])
    return padded(a, sides, float(value)) if suits and belongs_on_card(a) and math.isfinite(value) else NotImplemented


@on_card(_aten.replication_pad2d.default)
def _padded_by_edge(a: Any, sides: Sequence[int]) -> Any:
    """Wherever the values lie: what is grown by its edge is a frame that will be filtered on the card."""
    suits = isinstance(a, CardTensor) and a.dtype == torch.float32 and a.numel() > 0
    return padded(a, sides, None) if suits else NotImplemented
