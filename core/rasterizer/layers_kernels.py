"""Layers of a view by distance: each one's lists of tiles, its splats, and the way of its gradients back."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel
from .splat_kernels import BLUE, GAUSSIAN, M_ALL, M_BLUE, M_RED, RED, SLOT, SPLAT_WIDTH

f32 = np.float32


@inlined
def share_of(place, k):  # type: ignore[no-untyped-def]
    """How much of a Gaussian shows in layer `k`."""
    return max(f32(1.0) - abs(place - k), f32(0.0))


@inlined
def belongs(place, k):  # type: ignore[no-untyped-def]
    """Whether a Gaussian shows in layer `k`, or hides some of it."""
    return place > k - f32(1.0) and place < k + f32(2.0)


@kernel
def count_in_layer(begin, end, tile_starts, pairs, place, k, counts):  # type: ignore[no-untyped-def]
    """How many pairs of each of the tiles `begin` to `end` belong to layer `k`: counts [tiles] int64."""
    for tile in range(begin, end):
        found = 0
        for i in range(tile_starts[tile], tile_starts[tile + 1]):
            found += belongs(place[pairs[i, GAUSSIAN]], k)
        counts[tile] = found


@kernel
def list_layer(begin, end, tile_starts, pairs, place, k, starts, own, slots):  # type: ignore[no-untyped-def]
    """Writes the layer's lists of tiles: own [P', 2] pairs, each with a gradient slot at its own place.

    Args:
        starts: [tiles + 1] where each tile's list begins.
        slots: [P'] int32 output, the slots that these pairs have in the lists of all.
    """
    for tile in range(begin, end):
        to = starts[tile]
        for i in range(tile_starts[tile], tile_starts[tile + 1]):
            g = pairs[i, GAUSSIAN]
            if belongs(place[g], k):
                own[to, GAUSSIAN], own[to, SLOT], slots[to] = g, np.int32(to), pairs[i, SLOT]
                to += 1


@kernel
def splats_in_layer(begin, end, splats, place, k, coloured, covering):  # type: ignore[no-untyped-def]
    """The splats with their share in layer `k` times their colours [N, 16], and with it for a first colour [N, 16]."""
    for g in range(begin, end):
        share = share_of(place[g], k)
        for column in range(SPLAT_WIDTH):
            value = splats[g, column]
            colour = column >= RED and column <= BLUE
            coloured[g, column] = share * value if colour else value
            covering[g, column] = (share if column == RED else f32(0.0)) if colour else value


@kernel
def add_layer(begin, end, own, of_colours, of_covering, splats, place, k, to, slots, in_place):  # type: ignore[no-untyped-def]
    """Adds what came back through pairs `begin` to `end` of layer `k` to the slots of all.

    Args:
        own: [P', 2] of the layer; of_colours, of_covering: [P', 9] its slots, of `splats_in_layer`'s two.
        to: [P'] where they go in slots [P, 9], and in_place [P] float32 for the gradient in the Gaussian's place.
    """
    for i in range(begin, end):
        g, slot = own[i, GAUSSIAN], to[i]
        share = share_of(place[g], k)
        for column in range(M_ALL + 1):
            slots[slot, column] += of_colours[i, column] + of_covering[i, column]
        in_share = of_covering[i, M_RED]
        for column in range(M_RED, M_BLUE + 1):
            came = of_colours[i, column]
            slots[slot, column] += share * came
            in_share += splats[g, RED + column - M_RED] * came
        off = place[g] - k
        if abs(off) < f32(1.0):
            in_place[slot] -= np.sign(off) * in_share
