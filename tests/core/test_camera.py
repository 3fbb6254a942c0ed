"""Where a camera sees places of the world."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.camera import Camera
from scipy.spatial.transform import Rotation

TURN = Rotation.from_euler("xyz", [0.2, -0.4, 0.1]).as_matrix()
CAMERA = Camera("photo", 40, 30, 50.0, 48.0, 19.0, 16.0, TURN, np.array([0.1, -0.2, 0.3]))
#: In the camera's own axes: before it, beside its frame, and behind it.
PLACES = np.array([[0.1, -0.2, 2.0], [3.0, 0.0, 2.0], [0.1, -0.2, -2.0]])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_places_lie_where_the_pinhole_says_and_nowhere_behind_it(dtype: type) -> None:
    world = ((PLACES - CAMERA.translation) @ CAMERA.rotation).astype(dtype)
    px, depth = CAMERA.projected(world)
    np.testing.assert_allclose(depth, PLACES[:, 2], atol=1e-6)
    np.testing.assert_allclose(px[:2], [[50 * 0.05 + 19, 48 * -0.1 + 16], [50 * 1.5 + 19, 16]], rtol=1e-5)
    assert np.isnan(px[2]).all()
    assert CAMERA.in_frame(world).tolist() == [True, False, False]


def test_a_frame_is_as_wide_as_asked() -> None:
    """The place beside lies 54 px beyond a frame of 40 px."""
    world = (PLACES - CAMERA.translation) @ CAMERA.rotation
    assert CAMERA.in_frame(world, beside=1.34).tolist() == [True, False, False]
    assert CAMERA.in_frame(world, beside=1.36).tolist() == [True, True, False]
    assert CAMERA.projected(np.zeros((0, 3)))[0].shape == (0, 2)
