"""Matches at known cameras: how far off the epipolar lines they are, and the points that they give."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from dgs.core.lens import Lens
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.reconstruction import Figures, Reconstruction, no_points
from dgs.core.sfm import known_poses
from dgs.core.sfm import triangulate as triangulate_module
from dgs.core.sfm.features import Features
from dgs.core.sfm.job import KNOWN, POINTS, SfmJob, read_job, write_job
from dgs.core.sfm.known_poses import _essential, _matches, _off_lines, _triangulated, _write_points
from dgs.core.sfm.settings import SfmSettings
from dgs.core.sfm.triangulate import _row, triangulate
from dgs.tests.core.surface.scenes import BEHIND, RADIUS, arc, drawn
from scipy.linalg import hadamard
from scipy.spatial.transform import Rotation

from .models import model_of

TURN = Rotation.from_euler("xyz", [5.0, -20.0, 10.0], degrees=True).as_matrix()
FIRST = {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.0]}
SECOND = {"rotation": TURN.tolist(), "translation": [0.5, -0.25, 0.125]}
POINTS_SEEN = np.random.default_rng(0).uniform([-1, -1, 4], [1, 1, 6], (40, 3))


def rays(row: dict[str, Any], points: np.ndarray) -> np.ndarray:
    local = points @ np.array(row["rotation"]).T + np.array(row["translation"])
    return local / local[:, 2:]


def test_rays_of_one_point_lie_on_each_others_lines() -> None:
    essential = _essential(FIRST, SECOND)
    a, b = rays(FIRST, POINTS_SEEN), rays(SECOND, POINTS_SEEN)
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", b, essential, a), 0.0, atol=1e-12)
    assert np.linalg.norm(essential) == pytest.approx(np.sqrt(2) * np.linalg.norm(SECOND["translation"]))
    np.testing.assert_allclose(_off_lines(essential, a, b), 0.0, atol=1e-12)
    moved = _essential(SECOND, FIRST)
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", a, moved, b), 0.0, atol=1e-12)
    assert np.abs(np.einsum("ni,ij,nj->n", a, essential, b)).max() > 1e-3


def test_two_turned_cameras() -> None:
    other = {"rotation": TURN.T.tolist(), "translation": [1.0, 2.0, -0.5]}
    a, b = rays(SECOND, POINTS_SEEN), rays(other, POINTS_SEEN)
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", b, _essential(SECOND, other), a), 0.0, atol=1e-12)


def test_the_distance_from_the_lines_in_closed_form() -> None:
    """Sideways motion: lines are rows, and both rays share the distance: |y2 - y1| / sqrt(2)."""
    aside = {"rotation": np.eye(3).tolist(), "translation": [1.0, 0.0, 0.0]}
    first = np.array([[0.1, 0.2, 1.0], [0.0, 0.0, 1.0]])
    second = np.array([[0.7, 0.23, 1.0], [0.3, -0.04, 1.0]])
    found = _off_lines(_essential(FIRST, aside), first, second)
    np.testing.assert_allclose(found, [0.03 / np.sqrt(2), 0.04 / np.sqrt(2)])
    assert _off_lines(np.zeros((3, 3)), first, second).tolist() == [0.0, 0.0]


SIZE, FOCALS = (400, 300), {"a": 200.0, "b": 300.0}
LENSES = {
    name: {"model": "SIMPLE_PINHOLE", "width": 400, "height": 300, "params": [focal, 200.0, 150.0]}
    for name, focal in FOCALS.items()
}


def described(numbers: np.ndarray) -> np.ndarray:
    return ((hadamard(128)[numbers + 1] + 1) * 32).astype(np.uint8)


def two_photos(folder: Path, off: float = 0.0) -> tuple[SfmJob, dict[str, Any], dict[str, Features], dict[str, Any]]:
    """Both see 40 points in different order; every fourth feature of the second is off its line by `off` px."""
    order = np.random.default_rng(1).permutation(40)
    found = {}
    for name, row, numbers in (("a", FIRST, np.arange(40)), ("b", SECOND, order)):
        pixels = rays(row, POINTS_SEEN[numbers])[:, :2] * FOCALS[name] + [200.0, 150.0]
        if name == "b":
            pixels[numbers % 4 == 0] += [0.0, off]
        found[name] = Features(pixels.astype(np.float32), described(numbers))
    known = {"cameras": {n: {"lens": LENSES[n], **r} for n, r in (("a", FIRST), ("b", SECOND))}, "pairs": [["a", "b"]]}
    job = SfmJob(folder, {"a": folder, "b": folder}, {}, False, None, SfmSettings(threads=1))
    lenses = {name: pycolmap.Camera(**row) for name, row in LENSES.items()}
    return job, known, found, lenses


def test_matches_and_how_far_off_they_are(tmp_path: Path) -> None:
    job, known, found, lenses = two_photos(tmp_path, off=20.0)
    ((pair, (those, off)),) = _matches(job, known, found, lenses).items()
    assert pair == ("a", "b") and len(those) == 40
    order = np.random.default_rng(1).permutation(40)
    assert np.array_equal(order[those[:, 1]], those[:, 0])
    aside = those[:, 0] % 4 == 0
    assert off[~aside].max() < 1e-3 < 3.0 < off[aside].min()
    # Sampson's distance is in units of the focal length: the mean of both.
    first, second = (rays(r, POINTS_SEEN) for r in (FIRST, SECOND))
    second[:, 1] += 20.0 / FOCALS["b"]
    wanted = 250.0 * _off_lines(_essential(FIRST, SECOND), first, second)
    np.testing.assert_allclose(off[aside], wanted[those[aside, 0]], rtol=1e-3)


def test_photos_without_features_match_nothing(tmp_path: Path) -> None:
    job, known, found, lenses = two_photos(tmp_path)
    found["b"] = Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    those, off = _matches(job, known, found, lenses)["a", "b"]
    assert len(those) == len(off) == 0


def test_points_lie_where_the_rays_meet(tmp_path: Path) -> None:
    """Of three photos: COLMAP makes no point of what only two see."""
    job, known, found, lenses = two_photos(tmp_path)
    third = {"rotation": TURN.T.tolist(), "translation": [-0.5, 0.25, 0.5]}
    known["cameras"]["c"] = {"lens": LENSES["a"], **third}
    lenses["c"] = pycolmap.Camera(**LENSES["a"])
    pixels = rays(third, POINTS_SEEN)[:, :2] * FOCALS["a"] + [200.0, 150.0]
    found["c"] = Features(pixels.astype(np.float32), described(np.arange(40)))
    (tmp_path / "images").mkdir()
    order = np.random.default_rng(1).permutation(40)
    good = np.stack([np.arange(40), np.argsort(order)], axis=1)
    pairs = {("a", "b"): good[:30], ("c", "b"): good[5:35], ("a", "c"): good[:0]}
    model = _triangulated(job, known, found, lenses, pairs)
    assert model.num_points3D() == 25
    for point in model.points3D.values():
        assert np.linalg.norm(POINTS_SEEN[5:30] - point.xyz, axis=1).min() < 1e-3
        assert sorted(e.image_id for e in point.track.elements) == [1, 2, 3]
    for number, row in ((1, FIRST), (2, SECOND), (3, third)):  # the cameras stay as they are
        pose = model.images[number].cam_from_world()
        np.testing.assert_allclose(pose.rotation.matrix(), row["rotation"], atol=1e-9)
        np.testing.assert_allclose(pose.translation, row["translation"], atol=1e-9)
    assert sorted(c.params[0] for c in model.cameras.values()) == [200.0, 200.0, 300.0]


def test_points_and_who_sees_them_are_written(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0, 4.0], [0.5, 0.0, 4.0], [0.0, 0.5, 4.0]])
    model = model_of([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], points, seen_by=[(1, 3), (2, 1), (3, 2, 1)])
    _write_points(tmp_path / POINTS, model)
    with np.load(tmp_path / POINTS) as content:
        np.testing.assert_allclose(content["positions"], points)
        assert content["colours"].tolist() == [[0] * 3, [1] * 3, [2] * 3] and content["colours"].dtype == np.uint8
        assert json.loads(str(content["names"])) == ["0/0001.png", "0/0002.png", "0/0003.png"]
        assert content["observations"].tolist() == [[0, 0], [0, 2], [1, 1], [1, 0], [2, 2], [2, 1], [2, 0]]
    _write_points(tmp_path / "none.npz", model_of([(0.0, 0.0, 0.0)], points[:0]))
    with np.load(tmp_path / "none.npz") as content:
        assert content["positions"].shape == (0, 3) and content["observations"].shape == (0, 2)


# --- on photos --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene() -> Any:
    return drawn(arc(3), (200, 150), 210.0)


def pairs_of(scene: Any) -> list[tuple[str, str]]:
    names = [photo.name for photo in scene.photos]
    return [(names[0], names[1]), (names[2], names[1])]


def given_to_child(scene: Any, folder: Path, cameras: Reconstruction) -> SfmJob:
    names = write_job(scene.photos, None, SfmSettings(threads=1), folder)
    images = {name: image for image, name in names.items()}
    rows = {image: _row(cameras, name) for image, name in names.items()}
    chosen = [[images[a], images[b]] for a, b in pairs_of(scene)]
    (folder / KNOWN).write_text(json.dumps({"cameras": rows, "pairs": chosen}), encoding="utf-8")
    return read_job(folder)


def test_features_at_known_poses_in_this_process(scene: Any, tmp_path: Path) -> None:
    said: list[dict[str, Any]] = []
    job = given_to_child(scene, tmp_path, scene.cameras)
    result = known_poses.run(job, lambda **message: said.append(message))
    assert result.kind == "done" and said == [{"joined": 1}, {"joined": 3}]
    found = result.message
    assert found["matches"] > 60 and 0.6 < found["on_lines"] <= 1.0 and 0.0 < found["reprojection_px"] < 1.0
    assert 1.5 < found["angle_deg"] < 40.0
    with np.load(tmp_path / POINTS) as content:
        positions = content["positions"]
        assert len(positions) == found["points"] > 10 and content["colours"].std() > 2
    off = np.minimum(np.abs(np.linalg.norm(positions, axis=1) - RADIUS), np.abs(positions[:, 2] - BEHIND))
    assert np.median(off) < 0.05


def test_wrong_cameras_are_off_their_lines(scene: Any, tmp_path: Path) -> None:
    names = list(scene.cameras.poses)
    other = dict(zip(names, [scene.cameras.poses[n] for n in (names[1], names[2], names[0])], strict=True))
    wrong = Reconstruction(other, scene.cameras.lenses, no_points(), scene.cameras.figures)
    result = known_poses.run(given_to_child(scene, tmp_path, wrong), lambda **_: None)
    assert result.message["on_lines"] < 0.35


def test_pairs_that_are_not_to_be_matched_give_nothing(scene: Any, tmp_path: Path) -> None:
    job = given_to_child(scene, tmp_path, scene.cameras)
    known = json.loads((tmp_path / KNOWN).read_text())
    (tmp_path / KNOWN).write_text(json.dumps({**known, "pairs": []}))
    result = known_poses.run(job, lambda **_: None)
    assert result.message == {"matches": 0, "on_lines": 0.0, "points": 0, "reprojection_px": 0.0, "angle_deg": 0.0}


def test_a_child_triangulates(scene: Any, tmp_path: Path) -> None:
    found = triangulate(
        scene.photos, scene.cameras, pairs_of(scene), None, SfmSettings(threads=1), tmp_path / "work", Silent()
    )
    assert len(found.positions) > 10 and found.matches > 60 and found.on_lines > 0.6 and not found.contradicts
    assert 0.0 < found.reprojection_px < 1.0 and found.names == tuple(photo.name for photo in scene.photos)
    assert list(tmp_path.iterdir()) == []
    cameras = scene.cameras.cameras()
    for point, view in found.observations[::9]:
        camera = cameras[found.names[view]]
        local = camera.rotation @ found.positions[point] + camera.translation
        assert local[2] > 0 and 0 < local[0] / local[2] * camera.fx + camera.cx < camera.width


def test_what_the_child_is_given_and_what_it_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a child: names are translated both ways, and only the folder that it made is removed."""
    lens = Lens("PINHOLE", 40, 30, (50.0, 51.0, 20.0, 15.0))
    scene = drawn(arc(2), (40, 30))
    names = [photo.name for photo in scene.photos]
    poses = {name: Pose(TURN, np.array([0.0, 1.0, 2.0])) for name in names}
    cameras = Reconstruction(poses, dict.fromkeys(names, lens), no_points(), Figures("x", 2, 2, 0.0, 0.0, 0.0, 0.0))

    def child(folder: Path, given: int, *_: object) -> tuple[list[object], dict[str, Any]]:
        known = json.loads((folder / KNOWN).read_text())
        assert given == 2 and known["pairs"] == [["0/0001.png", "0/0000.png"]]
        row = known["cameras"]["0/0000.png"]
        assert row["lens"] == {"model": "PINHOLE", "width": 40, "height": 30, "params": [50.0, 51.0, 20.0, 15.0]}
        np.testing.assert_allclose(row["rotation"], TURN)
        assert row["translation"] == [0.0, 1.0, 2.0]
        np.savez(
            folder / POINTS,
            positions=np.ones((1, 3)),
            colours=np.ones((1, 3), np.uint8),
            names=np.array(json.dumps(["0/0001.png", "0/0000.png"])),
            observations=np.array([[0, 1]]),
        )
        return [], {"matches": 5, "on_lines": 0.25, "reprojection_px": 0.5}

    monkeypatch.setattr(triangulate_module, "talk", child)
    (tmp_path / "other").touch()
    found = triangulate(scene.photos, cameras, [(names[1], names[0])], None, SfmSettings(), tmp_path, Silent())
    assert found.names == (names[1], names[0]) and (found.matches, found.on_lines, found.reprojection_px) == (
        5,
        0.25,
        0.5,
    )
    assert [path.name for path in tmp_path.iterdir()] == ["other"]
