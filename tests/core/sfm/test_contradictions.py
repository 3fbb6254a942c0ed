"""Pairs of photos that a model does not explain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.core.sfm.contradictions import Agreement, agreement

from .models import database_of, geometry_of, grid_points, model_of, pixels_of, rigid

CENTRES = [(-0.6, 0.0, 0.0), (-0.2, 0.3, 0.0), (0.2, -0.3, 0.0), (0.6, 0.1, 0.0)]
#: In two planes: those of one alone leave cameras free.
POINTS = np.concatenate([grid_points(20, 4.0), grid_points(20, 6.0) + 0.05])
NAMES = [f"0/{number:04d}.png" for number in range(1, 5)]
PAIRS = [(a, b) for a in range(4) for b in range(a + 1, 4)]


def database(path: Path, matches: int = 40, shifted: int | None = None) -> Path:
    """All pairs of the four photos; features of one of them shifted downwards by 8 px."""
    descriptors = np.zeros((len(POINTS), 128), np.uint8)
    at = [pixels_of(centre, POINTS) + [0.0, 8.0 * (i == shifted)] for i, centre in enumerate(CENTRES)]
    features = {name: (points, descriptors) for name, points in zip(NAMES, at, strict=True)}
    pair = geometry_of([(i, i) for i in range(matches)])
    database_of(path / "d.db", features, {(NAMES[a], NAMES[b]): pair for a, b in PAIRS})
    return path / "d.db"


def model(turned: int | None = None) -> Any:
    """The true one, or with one camera that looks aside by 20 degrees from elsewhere."""
    found = model_of(CENTRES, POINTS)
    if turned is not None:
        c, s = np.cos(0.35), np.sin(0.35)
        rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        found.frame(found.images[turned].frame_id).set_cam_from_world(1, rigid((1.0, 0.5, 0.5), rotation))
    return found


def test_a_right_model_explains_all_pairs(tmp_path: Path) -> None:
    assert agreement(database(tmp_path), model()) == Agreement(contradicted=0.0, explained=1.0)


def test_pairs_of_a_wrong_camera_speak_against_it(tmp_path: Path) -> None:
    found = agreement(database(tmp_path), model(turned=3))
    assert found.contradicted == pytest.approx(3 / 6)
    assert 3 / 6 <= found.explained < 4 / 6  # one or the other match lies on a wrong line by chance


def test_features_that_err_by_more_than_blur_makes_them(tmp_path: Path) -> None:
    assert agreement(database(tmp_path, shifted=1), model()).contradicted == pytest.approx(3 / 6)


def test_pairs_of_few_matches_are_not_asked(tmp_path: Path) -> None:
    assert agreement(database(tmp_path, matches=14), model(turned=3)) == Agreement(contradicted=0.0, explained=0.0)


def test_matches_of_photos_without_a_place_are_not_explained(tmp_path: Path) -> None:
    half = model_of(CENTRES[:3], POINTS)
    assert agreement(database(tmp_path), half) == Agreement(contradicted=0.0, explained=pytest.approx(3 / 6))
