"""The order of splats from near to far, as the kernel's own source says it, in Python, where arrays have ends."""

from __future__ import annotations

import time

import numpy as np
from dgs.core.rasterizer.binning_kernels import depth_order
from dgs.core.rasterizer.splat_kernels import DEPTH, OPACITY, RED, SPLAT_WIDTH, X, Y


def test_splats_are_sorted_by_all_bits_of_their_depth() -> None:
    random = np.random.default_rng(0)
    splats = np.zeros((60, SPLAT_WIDTH), np.float32)
    splats[:, DEPTH] = np.concatenate(
        [random.uniform(1, 2, 20), 1 + np.arange(20) * 2.0**-23, 10.0 ** np.arange(-9, 11)]
    )
    seen = random.permutation(60)[:50].astype(np.int32)
    order = np.empty(50, np.int32)
    for sort in (depth_order.py_func, depth_order):
        order[:] = -1
        with np.errstate(all="raise"):
            sort(splats, seen, order)
        assert order.tolist() == seen[np.argsort(splats[seen, DEPTH], kind="stable")].tolist()


def test_splats_at_one_depth_are_sorted_by_content_however_many() -> None:
    """A flat wall that faces the camera: of 100,000 a picture took 5 s when each was compared with all before."""
    random = np.random.default_rng(0)
    columns = (X, Y, OPACITY, RED, RED + 1, RED + 2)
    for sort, count in ((depth_order.py_func, 1), (depth_order.py_func, 37), (depth_order, 37), (depth_order, 100_000)):
        splats = np.zeros((count, SPLAT_WIDTH), np.float32)
        splats[:, DEPTH] = 1.0 + (random.uniform(size=count) < 0.2)  # (two walls)
        splats[:, columns] = random.integers(0, 5, (count, len(columns)))  # (many agree in some, a few in all)
        order, seen = np.empty(count, np.int32), np.arange(count, dtype=np.int32)
        began = time.thread_time()
        sort(splats, seen, order)
        took = time.thread_time() - began
        assert took < 1.0 or count < 100_000, "(20 ms are usual; the first, short ones may compile)"
        keys = [splats[:, column] for column in (*columns[::-1], DEPTH)]
        assert order.tolist() == np.lexsort(keys).tolist()
