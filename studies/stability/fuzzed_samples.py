"""Small valid things that `reader_fuzz`'s files are made of."""

from __future__ import annotations

import numpy as np

from ...core.camera import Camera
from ...core.cloud import GaussianCloud
from ...core.views import SparsePoints


def cloud(count: int = 40) -> GaussianCloud:
    """Gaussians of degree 1."""
    random = np.random.default_rng(0)
    draw = lambda *shape: np.asarray(random.normal(size=shape), np.float32)  # noqa: E731
    return GaussianCloud(draw(count, 3), draw(count, 3) - 3, draw(count, 4), draw(count), draw(count, 4, 3))


def cameras() -> dict[str, Camera]:
    """Two cameras."""
    return {
        name: Camera(name, 40, 30, 35.0, 35.0, 20.0, 15.0, np.eye(3), np.array([x, 0.0, 2.0]))
        for name, x in (("a.png", 0.0), ("b.png", 1.0))
    }


def points() -> SparsePoints:
    """Twenty points."""
    return SparsePoints(np.random.default_rng(1).normal(size=(20, 3)), np.full((20, 3), 100, np.uint8))
