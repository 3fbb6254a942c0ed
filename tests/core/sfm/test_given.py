"""Which given camera belongs to which photo, and how it is fitted to the photo's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.errors import CameraError, DegenerateMotion, FormatError
from dgs.core.formats.colmap import write_model
from dgs.core.lens import Lens
from dgs.core.photos.load import Photo
from dgs.core.sfm.given import _fitted, _key, _table, load_cameras
from dgs.core.views import SparsePoints
from dgs.tests.core.sfm.models import tracked_model


def photo(name: str, width: int = 40, height: int = 30, scale: float = 1.0) -> Photo:
    return Photo(name, Path(name), np.full((height, width, 3), 9, np.uint8), scale=(scale, scale))


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("images/A 1.JPG", "a 1"),
        ("x\\y\\B.tar.gz", "b.tar"),
        ("plain", "plain"),
        (".hidden", ".hidden"),
        ("dir.d/x", "x"),
        ("e\u0301.png", "\u00e9"),
        ("STRASSE.png", "strasse"),
        ("stra\u00dfe.png", "strasse"),
    ],
)
def test_names_match_but_for_folder_case_and_extension(name: str, key: str) -> None:
    assert _key(name) == key


def test_two_cameras_of_one_name_are_refused() -> None:
    assert _table(["b/X.png", "y"]) == {"x": "b/X.png", "y": "y"}
    with pytest.raises(CameraError, match=r"'a/x\.png' and 'b/X\.jpg'"):
        _table(["b/X.jpg", "a/x.png"])


def test_a_lens_follows_the_size_of_its_photo() -> None:
    lens = Lens("PINHOLE", 80, 60, (50.0, 60.0, 41.0, 29.0))
    assert _fitted(lens, photo("a", 80, 60)) is lens
    half = _fitted(lens, photo("a", 40, 30))
    assert (half.width, half.height) == (40, 30) and half.params == pytest.approx((25.0, 30.0, 20.5, 14.5))


@pytest.mark.parametrize(("width", "fits"), [(1022, True), (1024, False), (978, True), (976, False)])
def test_a_shape_may_differ_by_a_hundredth_and_a_pixel(width: int, fits: bool) -> None:
    """Of 1000 x 80 px: 1 / 100 + 1 / 80 = 2.25 %."""
    lens = Lens("SIMPLE_PINHOLE", 1000, 80, (900.0, 500.0, 40.0))
    if fits:
        assert _fitted(lens, photo("a", width, 80)).width == width
    else:
        with pytest.raises(CameraError, match=f"1000 x 80 px, the photo {width} x 80"):
            _fitted(lens, photo("a", width, 80))


NO_POINTS = SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))


def written(folder: Path, centres: list[float], points: SparsePoints = NO_POINTS) -> Path:
    cameras = {}
    for index, x in enumerate(centres):
        name = f"in/{index}.PNG"
        centre = np.array([x, 0.0, -5.0])
        cameras[name] = Camera(name, 80, 60, 70.0 + 20 * index, 90.0 + 20 * index, 40, 30, np.eye(3), -centre)
    write_model(folder, cameras, points)
    return folder


def test_given_cameras_are_those_of_the_photos(tmp_path: Path) -> None:
    three = SparsePoints(np.arange(9.0).reshape(3, 3), np.full((3, 3), 7, np.uint8))
    path = written(tmp_path / "model", [0.0, 1.0, 2.0], three)
    found = load_cameras(path, [photo("1.jpg"), photo("0.jpg"), photo("other.jpg")])
    assert found.names == ("0.jpg", "1.jpg")
    assert found.lenses["1.jpg"].width == 40 and found.lenses["1.jpg"].params[:2] == pytest.approx((45.0, 55.0))
    np.testing.assert_allclose(found.cameras()["1.jpg"].centre, [1.0, 0.0, -5.0])
    np.testing.assert_allclose(found.points.positions, three.positions)
    figures = found.figures
    assert (figures.given, figures.registered, figures.scattered) == (3, 2, False)
    assert figures.focal_px == pytest.approx((40.0 + 50.0) / 2) and np.isnan(figures.reprojection_px)
    assert 0.0 <= figures.seconds < 60.0


def test_cameras_without_points_get_random_ones(tmp_path: Path) -> None:
    found = load_cameras(written(tmp_path / "model", [0.0, 1.0]), [photo("0.png"), photo("1.png")])
    assert found.figures.scattered and len(found.points.positions) == 5000


def test_cameras_at_one_place_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "model", [3.0, 3.0, 4.0])
    with pytest.raises(DegenerateMotion, match="all 2 cameras"):
        load_cameras(path, [photo("0.png"), photo("1.png")])
    assert load_cameras(path, [photo("0.png"), photo("2.png")]).names == ("0.png", "2.png")
    assert load_cameras(path, [photo("0.png")]).names == ("0.png",)


def test_cameras_of_other_photos_and_missing_ones(tmp_path: Path) -> None:
    path = written(tmp_path / "model", [0.0, 1.0])
    with pytest.raises(CameraError, match=r"for any of the 2 photos \(but for 'in/0\.PNG'"):
        load_cameras(path, [photo("x.png"), photo("y.png")])
    with pytest.raises(FormatError, match="There is no camera file"):
        load_cameras(tmp_path / "none", [photo("0.png")])


@pytest.mark.parametrize(
    ("error", "size", "found"), [(0.12, 160, True), (0.08, 160, False), (0.12, 80, False), (-1.0, 160, False)]
)
def test_cameras_whose_points_come_from_features_were_found_in_photos(
    tmp_path: Path, error: float, size: int, found: bool
) -> None:
    """Exact cameras have exact points; photos of half the size have half the error."""
    tracked_model(tmp_path, (error, error), binary=True)
    figures = load_cameras(tmp_path, [photo(f"000{n}.png", size * 5 // 4, size) for n in range(1, 5)]).figures
    assert figures.from_photos == found
    assert (
        figures.reprojection_px == pytest.approx(error * size / 160) if error > 0 else np.isnan(figures.reprojection_px)
    )


def test_a_file_of_llff_comes_of_structure_from_motion(tmp_path: Path) -> None:
    pose = np.concatenate([np.eye(3), np.zeros((3, 1)), [[60.0], [80.0], [70.0]]], axis=1)
    rows = np.stack([np.concatenate([pose.ravel(), [1.0, 9.0]])] * 2)
    rows[1, 3] = 1.0
    np.save(tmp_path / "poses_bounds.npy", rows)
    photos = [photo("a.png", 80, 60), photo("b.png", 80, 60)]
    assert load_cameras(tmp_path, photos).figures.from_photos
