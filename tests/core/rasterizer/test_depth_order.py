"""The order of splats from near to far, as the kernel's own source says it, in Python, where arrays have ends."""

from __future__ import annotations

import numpy as np
from dgs.core.rasterizer.binning_kernels import depth_order
from dgs.core.rasterizer.splat_kernels import DEPTH, SPLAT_WIDTH


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
