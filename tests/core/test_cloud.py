"""Clouds taken apart and put together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from dgs.core.cloud import GaussianCloud, cloud_part, finite_rows, joined


def test_clouds_are_joined() -> None:
    one = GaussianCloud(*(np.ones(shape, np.float32) for shape in ((2, 3), (2, 3), (2, 4), (2,), (2, 1, 3))))
    two = replace(one, sh=np.ones((2, 9, 3), np.float32))
    whole = joined([one, two])
    assert len(whole) == 4 and whole.sh.shape == (4, 9, 3)
    assert (whole.sh[:2, 1:] == 0).all() and (whole.sh[2:] == 1).all()
    assert joined([one], 4).sh.shape == (2, 4, 3)


def test_parts_and_finite_rows() -> None:
    means = np.arange(9, dtype=np.float32).reshape(3, 3)
    ones = (np.ones(shape, np.float32) for shape in ((3, 3), (3, 4), (3,), (3, 4, 3)))
    cloud = GaussianCloud(means, *ones)
    cloud.sh[1, 2, 0] = np.nan
    assert finite_rows(cloud).tolist() == [True, False, True]
    np.testing.assert_array_equal(cloud_part(cloud, finite_rows(cloud)).means, means[[0, 2]])
