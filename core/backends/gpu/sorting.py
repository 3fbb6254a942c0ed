"""Prefix sums and a stable radix sort on the card; the same result on every card and every time.

A table is cut into chunks, a group for each; every group adds up for itself what the chunks before its own came to.
So a pass of the sort takes one order, and prefix sums take two: an order costs more than adding up a few hundred
numbers again.
"""

from __future__ import annotations

import struct

from .card import Card, Memory
from .layout import SCAN_CHUNKS, SCAN_GROUP, SCAN_RUN, SORT_BITS, SORT_CHUNKS, SORT_RUN


def prefix_sums(card: Card, table: Memory, count: int) -> None:
    """Turns [count + 1] uint32 into the sums of the values before each; the total stands at the end."""
    chunk, chunks = _chunks(count, SCAN_GROUP * SCAN_RUN, SCAN_CHUNKS)
    numbers, totals = struct.pack("2I", count, chunk), card.memory(4 * chunks)
    if chunks > 1:  # (nothing is before the only one)
        card.run("scan_totals", (chunks, 1), numbers, table, totals)
    card.run("scan", (chunks, 1), numbers, totals, table)


def sort(card: Card, keys: Memory, values: Memory | None, count: int, bits: int) -> tuple[Memory, Memory]:
    """Sorts [count] uint32 by the lowest `bits` (at least one) of their keys; equal ones keep their order.

    Args:
        values: where they are None, they are the keys' places: 0 to count - 1.

    Returns:
        keys and values, sorted; the arguments' own memory is used on the way.
    """
    chunk, chunks = _chunks(count, SCAN_GROUP * SORT_RUN, SORT_CHUNKS)
    counts, next_counts, later_counts = (card.memory(chunks * 4 << SORT_BITS) for _ in range(3))
    other_keys, other_values = card.memory(4 * count), card.memory(4 * count)
    numbered = values is None  # (what stands in `given` is not read then)
    given = card.memory(4 * count) if values is None else values
    shift, widths = 0, _widths(bits) if count else []
    for place, width in enumerate(widths):
        next_width = widths[place + 1] if place + 1 < len(widths) else 0
        masks = (1 << width) - 1, shift + width, (1 << next_width) - 1
        numbers = struct.pack("8I", count, chunk, chunks, shift, *masks, numbered)
        if not place:
            card.run("radix_count", (chunks, 1), numbers, keys, counts, next_counts)
        tables = counts, next_counts, later_counts
        card.run("radix_scatter", (chunks, 1), numbers, keys, given, *tables, other_keys, other_values)
        keys, given, other_keys, other_values = other_keys, other_values, keys, given
        counts, next_counts, later_counts = next_counts, later_counts, counts
        shift, numbered = shift + width, False
    return keys, given


def _chunks(count: int, tile: int, most: int) -> tuple[int, int]:
    """How many values a chunk has, whole tiles, and how many chunks there are; one where there are no values."""
    chunk = tile * max(1, -(-count // (tile * most)))
    return chunk, max(1, -(-count // chunk))


def _widths(bits: int) -> list[int]:
    """Bits of each pass' digit: as few passes as can be, digits as short as can be then."""
    passes = -(-bits // SORT_BITS)
    return [bits // passes + (place < bits % passes) for place in range(passes)]
