"""Rows of tables on the card: chosen, and put together; what density control does with parameters and moments."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch

from .card import Memory, card
from .layout import GROUP
from .operands import belongs_on_card
from .tensors import CardTensor, empty, for_shader, on_card, part_for_shader, written

_aten = torch.ops.aten


def _is_table(tensor: Any) -> bool:
    return isinstance(tensor, CardTensor) and tensor.dtype == torch.float32 and tensor.ndim > 0


@lru_cache(maxsize=1)
def _on_card(rows: bytes) -> Memory:
    """Row numbers, uint32; the last ones are kept: the same are chosen of all parameters and moments."""
    memory = card().memory(len(rows))
    card().write(memory, np.frombuffer(rows, np.uint8))
    return memory


@on_card(_aten.index.Tensor)
def _chosen(table: Any, indices: Sequence[Any]) -> Any:
    """table[rows] for whole numbers `rows` [K]."""
    rows = indices[0]
    if len(indices) != 1 or not _is_table(table) or not belongs_on_card(table) or rows is None:
        return NotImplemented
    if rows.dtype != torch.int64 or rows.ndim != 1 or not rows.numel():
        return NotImplemented
    where = rows.cpu().numpy()
    where = np.where(where < 0, where + len(table), where)
    if where.min() < 0 or where.max() >= len(table):
        return NotImplemented  # (torch says so)
    made, width = empty(len(where), *table.shape[1:]), table.numel() // len(table)
    memories = for_shader(table), _on_card(where.astype(np.uint32).tobytes()), made.held.for_card(overwrite=True)
    card().for_each("rows", made.numel(), GROUP, struct.pack("2I", made.numel(), width), *memories)
    return written(made)


@on_card(_aten.cat.default)
def _joined(tables: Sequence[Any], axis: int = 0) -> Any:
    """Tables one below the other."""
    if axis != 0 or not all(_is_table(table) for table in tables):
        return NotImplemented
    present = [table for table in tables if table.numel()]
    if not present or any(t.shape[1:] != present[0].shape[1:] for t in tables) or not belongs_on_card(*present):
        return NotImplemented
    return _below_each_other(present, (sum(len(table) for table in present), *present[0].shape[1:]))


@on_card(_aten.stack.default)
def _stacked(tables: Sequence[Any], axis: int = 0) -> Any:
    """Tables of one shape, one behind the other."""
    if axis != 0 or not all(_is_table(table) for table in tables) or not belongs_on_card(*tables):
        return NotImplemented
    if any(table.shape != tables[0].shape for table in tables):
        return NotImplemented
    return _below_each_other(tables, (len(tables), *tables[0].shape))


def _below_each_other(tables: Sequence[Any], shape: tuple[int, ...]) -> CardTensor:
    """[shape] of all tables' values in their order."""
    made, at = empty(*shape), 0
    into = made.held.for_card(overwrite=True)
    for table in tables:
        memory, begins = part_for_shader(table)
        card().copy(memory, into, 4 * table.numel(), 4 * begins, at)
        at += 4 * table.numel()
    return written(made)
