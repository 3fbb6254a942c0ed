"""How many photos look at the same side of things."""

from __future__ import annotations

import numpy as np
from dgs.core.camera import Camera
from dgs.core.training.density.overlap import photos_of_one_side
from dgs.core.views import SparsePoints, View

#: On a unit sphere about the origin.
POINTS = np.random.default_rng(0).normal(size=(300, 3))
SPHERE = SparsePoints(0.1 * POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True), np.zeros((300, 3), np.uint8))


def looking_in(degrees: float, number: int, content: int | None = None) -> View:
    """From a circle of radius 4 towards the origin."""
    a = np.radians(degrees)
    z = np.array([np.cos(a), np.sin(a), 0.0])
    rotation = np.stack([np.array([-z[1], z[0], 0.0]), np.array([0.0, 0.0, -1.0]), z])
    camera = Camera(f"{number}.png", 64, 48, 60.0, 60.0, 32.0, 24.0, rotation, np.array([0.0, 0.0, 4.0]))
    photo = np.random.default_rng(number if content is None else content).integers(0, 255, (48, 64, 3))
    return View(camera, photo.astype(np.uint8))


def around(count: int, arc: float) -> list[View]:
    return [looking_in(arc * i / count, i) for i in range(count)]


def test_all_photos_of_one_side_count() -> None:
    assert photos_of_one_side(around(20, 50.0), SPHERE) == 20


def test_of_photos_all_round_a_third_looks_at_the_same_side() -> None:
    assert 12 <= photos_of_one_side(around(36, 360.0), SPHERE) <= 14  # 120 of 360 degrees, and the middle


def test_copies_count_once() -> None:
    views = [*around(6, 30.0), *(looking_in(5.0, 100 + i, content=0) for i in range(5))]
    assert photos_of_one_side(views, SPHERE) == 6


def test_where_no_point_is_in_any_frame_all_photos_count() -> None:
    far = SparsePoints(np.array([[0.0, 0.0, 500.0]]), np.zeros((1, 3), np.uint8))
    assert photos_of_one_side(around(5, 90.0), far) == 5
