"""Islands of a depth map: surfaces stay, chance agreements go."""

import numpy as np
from dgs.core.surface.speckles import SpeckleSettings, without_speckles
from dgs.core.surface.sweep import DepthMap


def test_surfaces_stay_and_what_stands_alone_goes() -> None:
    depth = np.zeros((30, 40), np.float32)
    depth[:, :20] = 4.0 * 1.03 ** np.arange(20)  # a slope: 3 % from px to px
    depth[5:8, 28:31] = 2.0  # nine px
    depth[15:20, 28:30] = 2.0  # ten
    depth[25, 25] = 9.0
    depth[10, 10] = 1.0  # within the slope
    one = DepthMap(3, depth, np.where(depth > 0, 0.5, 0).astype(np.float32))
    (found,) = without_speckles([one])
    assert found.view == 3 and found.depth.dtype == np.float32
    gone = (depth > 0) & (found.depth == 0)
    assert set(map(tuple, np.argwhere(gone))) == {
        (25, 25),
        (10, 10),
        *((r, c) for r in (5, 6, 7) for c in (28, 29, 30)),
    }
    assert (found.depth[~gone] == depth[~gone]).all() and ((found.confidence > 0) == (found.depth > 0)).all()


def test_an_empty_map_and_one_that_is_all_kept() -> None:
    empty = DepthMap(0, np.zeros((6, 5), np.float32), np.zeros((6, 5), np.float32))
    full = DepthMap(1, np.full((6, 5), 2.0, np.float32), np.ones((6, 5), np.float32))
    none, every = without_speckles([empty, full], SpeckleSettings(least=30))
    assert not none.depth.any() and (every.depth == 2.0).all()
    assert not without_speckles([full], SpeckleSettings(least=31))[0].depth.any()
