"""poses_bounds.npy: axes and order as LLFF writes them, names from the photos beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.errors import FormatError
from dgs.core.formats.cameras import brings_points, read_cameras
from dgs.core.formats.colmap import write_model
from dgs.core.formats.llff import read_llff
from dgs.core.photos.data_set import data_set
from dgs.core.views import SparsePoints
from dgs.studies.stability.fuzzed_samples import cameras

SIZES = {"a": (40, 30), "b": (40, 30)}


def row(right: np.ndarray, up: np.ndarray, centre: np.ndarray, size: tuple[float, float, float]) -> list[float]:
    """As LLFF's own imgs2poses writes it: the columns point down, right and backwards."""
    backward = np.cross(right, up)
    return [*np.stack([-up, right, backward, centre, np.array(size)], axis=1).ravel(), 1.0, 8.0]


def write(place: Path, rows: list[list[float]]) -> Path:
    np.save(place / "poses_bounds.npy", np.array(rows))
    return place / "poses_bounds.npy"


def test_a_camera_looks_where_llff_says(tmp_path):
    right, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])  # so it looks along -x
    file = write(tmp_path, [row(right, up, np.array([4.0, 5.0, 6.0]), (30, 40, 33.0))])
    lenses, poses = read_llff(file, {"only": (40, 30)})
    pose, lens = poses["only"], lenses["only"]
    assert np.allclose(pose.centre, [4.0, 5.0, 6.0])
    assert np.allclose(pose.rotation, [right, -up, [-1.0, 0.0, 0.0]])  # right, down, forward
    assert (lens.width, lens.height, lens.fx, lens.cx, lens.cy) == (40, 30, 33.0, 20.0, 15.0)


def test_rows_are_the_photos_in_the_order_of_their_names(tmp_path):
    (tmp_path / "images").mkdir()
    for name in ("b.JPG", "a.png", "notes.txt"):
        (tmp_path / "images" / name).write_bytes(b"")
    at = [row(np.eye(3)[0], -np.eye(3)[1], np.full(3, float(i)), (30, 40, 33.0)) for i in range(2)]
    write(tmp_path, at)
    found = read_cameras(tmp_path)
    assert found.spec.name == "llff" and not brings_points(tmp_path)
    assert {name: pose.centre[0] for name, pose in found.poses.items()} == {"a.png": 0.0, "b.JPG": 1.0}


def test_a_model_beside_it_comes_first_as_it_has_points(tmp_path):
    at = [row(np.eye(3)[0], -np.eye(3)[1], np.zeros(3), (30, 40, 33.0))] * 2
    (tmp_path / "images").mkdir()
    for name in ("a.png", "b.png"):
        (tmp_path / "images" / name).write_bytes(b"")
    file = write(tmp_path, at)
    alone = data_set(tmp_path)
    assert alone is not None and (alone.photos, alone.cameras) == (tmp_path / "images", file)
    write_model(tmp_path / "sparse" / "0", cameras(), SparsePoints(np.ones((3, 3)), np.zeros((3, 3), np.uint8)))
    assert read_cameras(tmp_path).spec.name == "colmap"
    both = data_set(tmp_path)
    assert both is not None and both.cameras == tmp_path / "sparse" / "0"


@pytest.mark.parametrize(
    "rows",
    [
        np.zeros((2, 16)),
        np.zeros((0, 17)),
        np.full((2, 17), np.nan),
        np.zeros((2, 17)),  # no pose
        np.zeros(17),
        np.zeros((3, 17)),  # one more than there are photos
    ],
)
def test_what_is_no_such_file_is_refused_by_name(tmp_path, rows):
    np.save(tmp_path / "poses_bounds.npy", rows)
    with pytest.raises(FormatError, match=r"poses_bounds\.npy"):
        read_llff(tmp_path / "poses_bounds.npy", SIZES)


@pytest.mark.parametrize("size", [(0.0, 40.0, 33.0), (30.0, 40.0, -1.0), (30.0, 1e9, 33.0)])
def test_a_lens_that_cannot_be_is_refused(tmp_path, size):
    file = write(tmp_path, [row(np.eye(3)[0], -np.eye(3)[1], np.zeros(3), size)] * 2)
    with pytest.raises(FormatError, match="no such lens"):
        read_llff(file, SIZES)
