"""Between which depths surfaces are sought, in views that see features and in those that see none."""

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.imaging.medium import Medium
from dgs.core.sfm.triangulate import Triangulated
from dgs.core.surface.depths import SETTINGS, KnownScene, depth_bounds
from dgs.core.surface.stack import stack_pictures


def _row(places: list[float]) -> KnownScene:
    """Cameras on a line, side by side, all looking along z."""
    size = (48, 64)
    cameras = [
        Camera(str(i), 64, 48, 64.0, 64.0, 32.0, 24.0, np.eye(3), -np.array([x, 0.0, 0.0]))
        for i, x in enumerate(places)
    ]
    views = stack_pictures(cameras, [np.zeros(size, np.float32)] * len(places), [np.ones(size, bool)] * len(places))
    return KnownScene([], None, Medium(), views, None)


def _features(x: float, depth: float, count: int = 60) -> Triangulated:
    """Points around a place before the cameras; no camera is named as having found them."""
    spread = np.random.default_rng(0).uniform(-1, 1, (count, 3)) * [0.5, 0.5, 0.1 * depth]
    where = np.array([x, 0.0, depth]) + spread
    return Triangulated(where, np.zeros((count, 3), np.uint8), np.zeros((0, 2), np.int64), ())


def test_a_view_without_features_takes_the_depths_of_those_beside_it():
    """The last one is beside the others and sees nothing of what they found; where all look says nothing either."""
    scene = _row([0.0, 0.3, 0.6, 0.9, 30.0])
    bounds = depth_bounds(range(5), scene, _features(0.5, 20.0))
    assert all(12 < near < 16 and 28 < far < 38 for near, far in bounds)
    assert bounds[4] == (min(b[0] for b in bounds[1:4]), max(b[1] for b in bounds[1:4]))


def test_those_that_look_the_same_way_are_asked_first():
    """Between two groups with depths of their own, the nearer one decides."""
    scene = _row([0.0, 0.1, 0.2, 30.0, 100.0, 100.1, 100.2])
    both = [_features(0.1, 20.0), _features(100.1, 60.0)]
    features = Triangulated(
        np.concatenate([one.positions for one in both]), np.zeros((120, 3), np.uint8), np.zeros((0, 2), np.int64), ()
    )
    bounds = depth_bounds(range(7), scene, features)
    assert bounds[3] == (min(b[0] for b in bounds[:3]), max(b[1] for b in bounds[:3])) and bounds[4][0] > 30


@pytest.mark.parametrize("features", [None, _features(0.0, 20.0, count=5)])
def test_without_features_the_cameras_alone_say(features):
    """Too few features are none: the range is as wide as it is where nothing is found."""
    scene = _row([0.0, 1.0, 2.0])
    expected = SETTINGS.blind_farthest / SETTINGS.blind_nearest
    assert all(near > 0 and np.isclose(far / near, expected) for near, far in depth_bounds(range(3), scene, features))
