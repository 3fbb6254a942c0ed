"""How kernels are handed to threads: every item once, errors to the caller, several callers at a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from dgs.core import compiled


@pytest.fixture(autouse=True)
def three_threads() -> Iterator[None]:
    before = compiled.threads()
    compiled.set_threads(3)
    yield
    compiled.set_threads(before)


@pytest.mark.parametrize("items", [0, 1, 2, 7, 100, 1001])
@pytest.mark.parametrize("grain", [1, 8, 5000])
def test_every_item_is_done_once(items: int, grain: int) -> None:
    counts = np.zeros(items, np.int64)

    def kernel(begin: int, end: int, counted: np.ndarray) -> None:
        counted[begin:end] += 1

    compiled.run(kernel, items, counts, grain=grain)
    assert (counts == 1).all()


def test_several_kernels_of_different_sizes_are_all_done() -> None:
    sizes = (0, 3, 1000, 17)
    counts = [np.zeros(size, np.int64) for size in sizes]

    def kernel(begin: int, end: int, counted: np.ndarray, by: int) -> None:
        counted[begin:end] += by

    compiled.run_all([(kernel, size, (counts[i], i + 1)) for i, size in enumerate(sizes)])
    assert all((count == i + 1).all() for i, count in enumerate(counts))


def test_other_threads_help() -> None:
    seen: set[int] = set()
    together = threading.Barrier(3, timeout=30)

    def kernel(begin: int, end: int) -> None:
        if threading.get_ident() not in seen:
            seen.add(threading.get_ident())
            together.wait()  # goes on only when three threads are here at once

    compiled.run(kernel, 300)
    assert len(seen) == 3


@pytest.mark.parametrize("whose", ["the caller's", "a helper's"])
def test_an_error_reaches_the_caller_once_nobody_works_any_more(whose: str) -> None:
    caller, working = threading.get_ident(), []
    together = threading.Barrier(3, timeout=30)

    def kernel(begin: int, end: int) -> None:
        if begin < 3 * (end - begin):  # the first three chunks, one each
            together.wait()
            if (threading.get_ident() == caller) == (whose == "the caller's"):
                raise ArithmeticError("a chunk failed")
        working.append(begin)
        time.sleep(0.002)
        working.remove(begin)

    with pytest.raises(ArithmeticError, match="a chunk failed"):
        compiled.run(kernel, 240)
    assert working == []


def test_several_callers_at_a_time() -> None:
    def kernel(begin: int, end: int, counted: np.ndarray) -> None:
        counted[begin:end] += 1
        time.sleep(0.0005)

    def call(_: int) -> bool:
        counts = np.zeros(100, np.int64)
        compiled.run(kernel, len(counts), counts)
        return bool((counts == 1).all())

    with ThreadPoolExecutor(6) as callers:
        assert all(callers.map(call, range(24)))


def test_large_photos_are_not_all_worked_on_at_once() -> None:
    """Two of 24 megapixels, however many threads there are; small ones are as many as threads."""
    compiled.set_threads(16)
    assert [compiled.photos_at_once(pixels) for pixels in (0, 240_000, 24_000_000, 10**9)] == [16, 16, 2, 1]
    compiled.set_threads(1)
    assert compiled.photos_at_once(240_000) == 1
