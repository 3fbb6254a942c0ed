"""What hangs together: islands of a graph, against a walk through it."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.islands import island_sizes, islands


def walked(count: int, pairs: np.ndarray) -> list[int]:
    """The least row that can be reached from each, by walking."""
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for a, b in pairs.tolist():
        neighbours[a].add(b)
        neighbours[b].add(a)
    found = [-1] * count
    for start in range(count):
        todo = [start] if found[start] < 0 else []
        while todo:
            row = todo.pop()
            if found[row] < 0:
                found[row] = start
                todo += neighbours[row]
    return found


@pytest.mark.parametrize(("count", "links"), [(1, 0), (50, 20), (300, 200), (300, 900)])
def test_islands_are_what_a_walk_finds(count: int, links: int) -> None:
    random = np.random.default_rng(count + links)
    for _ in range(20):
        pairs = random.integers(0, count, (links, 2))
        roots = islands(count, pairs)
        assert roots.tolist() == walked(count, pairs)
        assert island_sizes(roots).tolist() == [roots.tolist().count(root) for root in roots.tolist()]


def test_a_long_chain_is_one_island_soon() -> None:
    """Labels halve their way: a chain of 100,000 in any order takes a moment, not 100,000 rounds."""
    order = np.random.default_rng(0).permutation(100_000)
    assert (islands(len(order), np.stack([order[:-1], order[1:]], axis=1)) == 0).all()
