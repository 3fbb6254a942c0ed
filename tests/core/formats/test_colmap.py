"""Camera models read without native code, against pycolmap's reader."""

from pathlib import Path

import numpy as np
import pytest
from dgs.core.errors import FormatError, OutputError
from dgs.core.formats.colmap import CONFIDENCE, read_colmap_cameras, read_colmap_points, read_model, write_lenses
from dgs.core.lens import MODELS, Lens
from dgs.core.pose import Pose
from dgs.core.reconstruction import no_points
from dgs.core.views import SparsePoints
from dgs.tests.core.sfm.models import tracked_model
from dgs.tests.crashes import DONE, REFUSED, SmallDisk, can_mount, status_of

pytest.importorskip("pycolmap")


def _write(folder: Path, binary: bool) -> None:
    generator = np.random.default_rng(3)
    lenses, poses = {}, {}
    for index, (model, (simple, distortion)) in enumerate(MODELS.items()):
        # pycolmap itself cuts names at a blank in text files.
        name = f"photo {index} ü.png" if binary else f"photo-{index}-ü.png"
        head = (500.0, 320.5, 240.25) if simple else (500.0, 510.0, 320.5, 240.25)
        lenses[name] = Lens(model, 640, 480, (*head, *(0.01 * (k + 1) for k in range(distortion))))
        rotation = np.linalg.qr(generator.normal(size=(3, 3)))[0]
        poses[name] = Pose(rotation * np.linalg.det(rotation), generator.normal(size=3))
    write_lenses(folder, lenses, poses, no_points(), binary=binary)


@pytest.mark.parametrize("binary", [True, False])
def test_reads_every_lens_as_pycolmap_does(tmp_path: Path, binary: bool) -> None:
    _write(tmp_path / "cameras", binary)
    lenses, poses = read_colmap_cameras(tmp_path)
    expected_lenses, expected_poses, _ = read_model(tmp_path)
    assert lenses.keys() == expected_lenses.keys()
    for name, lens in lenses.items():
        expected = expected_lenses[name]
        assert (lens.model, lens.width, lens.height) == (expected.model, expected.width, expected.height)
        np.testing.assert_allclose(lens.params, expected.params, rtol=1e-12)
    assert poses.keys() == expected_poses.keys()
    for name, pose in poses.items():
        np.testing.assert_allclose(pose.rotation, expected_poses[name].rotation, atol=1e-12)
        np.testing.assert_allclose(pose.translation, expected_poses[name].translation, atol=1e-12)


@pytest.mark.parametrize("binary", [True, False])
def test_reads_points_as_pycolmap_does(tmp_path: Path, binary: bool) -> None:
    generator = np.random.default_rng(5)
    lens, pose = Lens("PINHOLE", 64, 48, (50.0, 50.0, 32.0, 24.0)), Pose(np.eye(3), np.zeros(3))
    points = SparsePoints(generator.normal(size=(50, 3)), generator.integers(0, 256, (50, 3)).astype(np.uint8))
    write_lenses(tmp_path, {"a": lens}, {"a": pose}, points, binary=binary)
    read = read_colmap_points(tmp_path)
    np.testing.assert_allclose(read.positions, points.positions, atol=1e-9)
    np.testing.assert_array_equal(read.colours, points.colours)
    file = tmp_path / ("points3D.bin" if binary else "points3D.txt")
    file.write_bytes(file.read_bytes()[: -30 if binary else -25])
    with pytest.raises(FormatError, match="damaged"):
        read_colmap_points(tmp_path)
    file.unlink()
    assert len(read_colmap_points(tmp_path).positions) == 0


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("errors", [(0.2, 1.1, -1.0), (-1.0, -1.0, -1.0)])
def test_a_model_says_how_far_its_features_lie_beside_its_points(tmp_path: Path, binary: bool, errors) -> None:
    """In the mean over all observations: 2 of the first point, 4 of the second; -1 is an error that nobody computed."""
    tracked_model(tmp_path, errors, binary)
    error = read_colmap_points(tmp_path).error_px
    assert error == pytest.approx((2 * 0.2 + 4 * 1.1) / 6) if max(errors) > 0 else np.isnan(error)


def test_an_error_of_points_without_tracks_is_none(tmp_path: Path) -> None:
    """Programs that write models of their own put any number there."""
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 64 48 50 50 32 24\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    (tmp_path / "points3D.txt").write_text("1 0 0 3 9 9 9 0.5\n2 0 1 3 9 9 9 0.5\n")
    assert np.isnan(read_colmap_points(tmp_path).error_px)


def test_a_cut_off_model_is_explained(tmp_path: Path) -> None:
    _write(tmp_path, binary=True)
    file = tmp_path / "images.bin"
    file.write_bytes(file.read_bytes()[:150])
    with pytest.raises(FormatError, match="damaged"):
        read_colmap_cameras(tmp_path)


@pytest.mark.parametrize("binary", [True, False])
def test_confidence_of_dense_points_survives(tmp_path: Path, binary: bool) -> None:
    generator = np.random.default_rng(7)
    lens, pose = Lens("PINHOLE", 64, 48, (50.0, 50.0, 32.0, 24.0)), Pose(np.eye(3), np.zeros(3))
    positions, colours = generator.normal(size=(30, 3)), generator.integers(0, 256, (30, 3)).astype(np.uint8)
    sure = generator.uniform(0.01, 1, 30).astype(np.float32)
    write_lenses(tmp_path, {"a": lens}, {"a": pose}, SparsePoints(positions, colours, sure), binary=binary)
    read = read_colmap_points(tmp_path)
    np.testing.assert_array_equal(read.confidence, sure)
    np.testing.assert_allclose(read.positions, positions, atol=1e-9)
    chosen = read.chosen(np.array([3, 1]))
    np.testing.assert_array_equal(chosen.confidence, sure[[3, 1]])
    np.testing.assert_array_equal(chosen.colours, colours[[3, 1]])
    # Another program may have put other points there; they are taken as sparse ones.
    np.save(tmp_path / CONFIDENCE, sure[:-1])
    assert read_colmap_points(tmp_path).confidence is None
    (tmp_path / CONFIDENCE).write_bytes(b"nothing of the kind")
    with pytest.raises(FormatError, match="confidence"):
        read_colmap_points(tmp_path)
    write_lenses(tmp_path, {"a": lens}, {"a": pose}, SparsePoints(positions, colours), binary=binary)
    assert read_colmap_points(tmp_path).confidence is None and not (tmp_path / CONFIDENCE).exists()


@pytest.mark.skipif(not can_mount(), reason="this user may mount no disk")
def test_a_full_disk_is_noticed_wherever_it_fills_up(tmp_path: Path) -> None:
    """pycolmap goes on as if it had written everything."""
    lens, count = Lens("PINHOLE", 64, 48, (72.0, 72.0, 32.0, 24.0)), 200
    poses = {f"{name}.png": Pose(np.eye(3), np.array([name, 0.0, 0.0])) for name in range(count)}
    points = SparsePoints(np.ones((count, 3)), np.full((count, 3), 9, np.uint8))

    def on_a_disk_of(pages: int) -> None:
        disk = SmallDisk(tmp_path)
        disk.leave_room(pages * 4096)
        write_lenses(tmp_path, dict.fromkeys(poses, lens), poses, points)

    found = [status_of(lambda p=pages: on_a_disk_of(p), OutputError) for pages in range(1, 15)]  # type: ignore[misc]
    assert set(found) == {DONE, REFUSED} and found == sorted(found, reverse=True)
    assert found.count(REFUSED) > 8
