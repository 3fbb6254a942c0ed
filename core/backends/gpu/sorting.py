"""Prefix sums and a stable radix sort on the card; the same result on every card and every time."""

from __future__ import annotations

import struct

from .card import Card, Memory
from .layout import SORT_BITS, SORT_GROUP, SORT_RUN

_BLOCK = SORT_GROUP * SORT_RUN


def prefix_sums(card: Card, table: Memory, count: int) -> None:
    """Turns [count + 1] uint32 into the sums of the values before each; the total stands at the end."""
    card.run("scan", (1, 1), struct.pack("I", count), table)


def sort(card: Card, keys: Memory, values: Memory, count: int, bits: int) -> tuple[Memory, Memory]:
    """Sorts [count] uint32 by the lowest `bits` of their keys; equal ones keep their order.

    Returns:
        keys and values, sorted; the arguments' own memory is used on the way.
    """
    blocks = -(-count // _BLOCK)
    counts = card.memory(4 * ((blocks << SORT_BITS) + 1))
    other_keys, other_values = card.memory(4 * count), card.memory(4 * count)
    for shift in range(0, bits, SORT_BITS):
        numbers = struct.pack("3I", count, shift, blocks)
        card.for_each("radix_count", count, _BLOCK, numbers, keys, counts)
        prefix_sums(card, counts, blocks << SORT_BITS)
        card.for_each("radix_scatter", count, _BLOCK, numbers, keys, values, counts, other_keys, other_values)
        keys, values, other_keys, other_values = other_keys, other_values, keys, values
    return keys, values
