"""Which things hang together, when it is known which pairs touch. Needs numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]


def islands(count: int, pairs: Rows) -> Rows:
    """The connected components of a graph.

    Args:
        count: N things.
        pairs: [M, 2] rows of things that touch.

    Returns:
        [N] the least row of the island that each thing belongs to.
    """
    root = np.arange(count)
    first, second = pairs.reshape(-1, 2).T
    while True:
        before = root.copy()
        least = np.minimum(root[first], root[second])
        for end in (first, second):  # a root takes the least label that any of its things has met
            np.minimum.at(root, before[end], least)
        shorter = root[root]
        while not np.array_equal(shorter, root):
            root, shorter = shorter, shorter[shorter]
        if np.array_equal(root, before):
            return root


def island_sizes(roots: Rows) -> Rows:
    """[N] how many things the island of each thing has, from `islands`."""
    sizes: Rows = np.bincount(roots, minlength=len(roots))[roots]
    return sizes
