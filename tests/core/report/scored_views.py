"""Cameras on a ring, and scores of views, from which a verdict is made."""

from __future__ import annotations

import numpy as np
from dgs.core.evaluation.view_scores import ViewScores
from dgs.core.lens import Lens
from dgs.core.pose import Pose
from dgs.core.reconstruction import Figures, Reconstruction
from dgs.core.views import SparsePoints

NAMES = [f"{i}.png" for i in range(8)]


def ring_of(step: float) -> Reconstruction:
    """Eight cameras `step` degrees apart around the origin, from where they look at a point."""
    poses = {}
    for i, name in enumerate(NAMES):
        angle = np.radians(step * i)
        centre = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        poses[name] = Pose(rotation, -rotation @ centre)
    lens = Lens("SIMPLE_PINHOLE", 10, 10, (10.0, 5.0, 5.0))
    points = SparsePoints(np.zeros((3, 3)), np.zeros((3, 3), np.uint8))
    nan = float("nan")
    return Reconstruction(poses, dict.fromkeys(NAMES, lens), points, Figures("given", 8, 8, 10.0, nan, nan, 0.0))


def scored(name: str, error: float, part: int | None = None, matched_gain: float = 0.0) -> ViewScores:
    """A view whose squared error is `error` of the photo's variance, in one part only or everywhere."""
    random = np.random.default_rng(0)
    photo = random.uniform(0, 1, (90, 90, 3))
    render = photo.copy()
    rows, columns = (
        (slice(None), slice(None)) if part is None else (slice(30 * (part // 3), 30 * (part // 3) + 30),) * 2
    )
    count = 1.0 if part is None else 9.0
    render[rows, columns] += np.sqrt(error * count * photo.var(axis=(0, 1)).mean())
    score = ViewScores(name)
    score.add_photo(render, photo, None, 20.0)
    assert score.degraded is not None and score.degraded["psnr"] is not None
    score.degraded["psnr_matched"] = score.degraded["psnr"] + matched_gain
    return score
