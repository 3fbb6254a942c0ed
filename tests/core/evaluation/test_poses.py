from __future__ import annotations

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.errors import CameraError
from dgs.core.evaluation.poses import align_similarity, pose_errors, scene_depth
from scipy.spatial.transform import Rotation

POINTS = np.random.default_rng(1).uniform(-2, 2, (300, 3)) * [1, 1, 0.1]


def camera(name: str, centre: np.ndarray, rotation: np.ndarray) -> Camera:
    return Camera(name, 80, 60, 100.0, 100.0, 40.0, 30.0, rotation, -rotation @ centre)


def transformed(cameras: dict[str, Camera], scale: float, turn: np.ndarray, shift: np.ndarray) -> dict[str, Camera]:
    return {n: camera(n, scale * turn @ c.centre + shift, c.rotation @ turn.T) for n, c in cameras.items()}


def rail(collinear: bool) -> dict[str, Camera]:
    noise = np.random.default_rng(0)
    result = {}
    for i in range(6):
        centre = np.array([i - 2.5, 0.0, -5.0]) + (0 if collinear else 1) * noise.standard_normal(3)
        result[str(i)] = camera(str(i), centre, Rotation.from_euler("y", 5 * i, degrees=True).as_matrix())
    return result


@pytest.mark.parametrize("collinear", [False, True])
def test_any_similarity_is_undone(collinear: bool) -> None:
    reference = rail(collinear)
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    moved = transformed(reference, 7.0, turn, np.array([100.0, -3.0, 5.0]))
    errors = pose_errors(moved, reference, POINTS)
    assert errors.alignment.rank == (1 if collinear else 3)
    assert errors.alignment.scale == pytest.approx(1 / 7)
    np.testing.assert_allclose(errors.centre_px, 0, atol=1e-8)
    np.testing.assert_allclose(errors.angle, 0, atol=1e-6)


def test_a_rail_keeps_its_roll() -> None:
    reference = rail(True)
    rolled = {
        n: c.moved(Rotation.from_euler("z", 10, degrees=True).as_matrix() @ c.rotation, c.translation)
        for n, c in reference.items()
    }
    rolled = {n: camera(n, reference[n].centre, c.rotation) for n, c in rolled.items()}
    assert pose_errors(rolled, reference).angle.max() > 3.0


def test_px_equivalent_is_error_over_depth_times_focal() -> None:
    reference = rail(False)
    estimated = dict(reference)
    estimated["2"] = camera("2", reference["2"].centre + [0.001, 0, 0], reference["2"].rotation)
    errors = pose_errors(estimated, reference, POINTS)
    depth = scene_depth(reference["2"], POINTS)
    assert errors.centre_px[2] == pytest.approx(errors.centre[2] / depth * 100, rel=1e-9)
    assert 0.0005 < errors.centre[2] < 0.001  # the alignment takes up a part
    assert errors.centre_px[[0, 1, 3, 4, 5]].max() < 0.6 * errors.centre_px[2]


def test_the_scenes_depth_is_the_median_of_what_the_frame_shows() -> None:
    one = camera("", np.array([0.0, 0.0, -5.0]), np.eye(3))
    shown = [[0.0, 0.0, 0.0], [0.1, 0.1, 1.0], [0.0, 0.2, 4.0]]
    beside, behind = [9.0, 0.0, 0.0], [0.0, 0.0, -6.0]
    assert scene_depth(one, np.array([*shown, beside, beside, behind, behind])) == pytest.approx(6.0)
    assert np.isnan(scene_depth(one, np.array([beside, behind])))


def test_all_in_one_place_and_no_common_name() -> None:
    one = {n: camera(n, np.ones(3), c.rotation) for n, c in rail(True).items()}
    similarity = align_similarity(one, one)
    assert similarity.rank == 0 and similarity.scale == 1.0
    with pytest.raises(CameraError):
        align_similarity(one, {"x": one["0"]})
