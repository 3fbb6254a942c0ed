"""Folders of photos and cameras, as other programs lay them out, are found; folders of photos stay what they are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from dgs.core.formats.cameras import read_cameras
from dgs.core.photos.data_set import data_set, photos_in, with_data_set
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings
from PIL import Image


class Notes(Silent):
    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


def pictures(folder: Path, names: list[str]) -> None:
    folder.mkdir(parents=True)
    for name in names:
        Image.fromarray(np.full((12, 16, 3), 90, np.uint8)).save(folder / name)


def transforms(file: Path, names: list[str]) -> None:
    frames = [{"file_path": name, "transform_matrix": np.eye(4).tolist()} for name in names]
    file.write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}), "utf-8")


def nerf(root: Path) -> Path:
    """As NeRF's synthetic scenes: no endings, and photos of the same names in two folders."""
    for part in ("train", "test"):
        pictures(root / part, ["r_0.png", "r_1.png"])
        transforms(root / f"transforms_{part}.json", [f"./{part}/r_0", f"./{part}/r_1"])
    return root


def colmap(root: Path, model: str = "sparse/0", images: str = "images") -> Path:
    pictures(root / images, ["a.jpg", "b.jpg"])
    (root / model).mkdir(parents=True)
    for name in ("cameras", "images", "points3D"):
        (root / model / f"{name}.bin").write_bytes(b"")
    return root


def test_a_nerf_scene_is_its_training_photos(tmp_path):
    found = data_set(nerf(tmp_path))
    assert found is not None
    assert (found.photos, found.cameras) == (tmp_path / "train", tmp_path / "transforms_train.json")
    assert found.unused == (tmp_path / "transforms_test.json",)
    assert set(read_cameras(found.cameras, {"r_0": (16, 12), "r_1": (16, 12)}).poses) == {"r_0", "r_1"}


def test_a_transforms_json_says_where_its_photos_lie(tmp_path):
    pictures(tmp_path / "images", ["a.jpg", "b.jpg"])
    pictures(tmp_path / "images_4", ["a.jpg", "b.jpg"])
    transforms(tmp_path / "transforms.json", ["images_4/a.jpg", "images_4/b.jpg"])
    found = data_set(tmp_path)
    assert found is not None and found.photos == tmp_path / "images_4" and found.unused == ()


@pytest.mark.parametrize("model", ["sparse/0", "sparse", "colmap/sparse/0"])
@pytest.mark.parametrize("images", ["images", "input"])
def test_a_colmap_folder_is_its_images(tmp_path, model, images):
    found = data_set(colmap(tmp_path, model, images))
    assert found is not None
    assert (found.photos, found.cameras) == (tmp_path / images, tmp_path / model)


def test_a_folder_of_photos_is_no_data_set_whatever_lies_beside_them(tmp_path):
    colmap(tmp_path)
    Image.fromarray(np.zeros((12, 16, 3), np.uint8)).save(tmp_path / "photo.png")
    assert data_set(tmp_path) is None
    assert photos_in(tmp_path) == tmp_path


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", '{"frames": 3}', '{"frames": [1]}', '{"frames": [{"file_path": 4}]}', '{"frames": [{}]}'],
)
def test_a_damaged_file_of_cameras_is_no_data_set(tmp_path, content):
    pictures(tmp_path / "images", ["a.png"])
    (tmp_path / "transforms.json").write_text(content, "utf-8")
    assert data_set(tmp_path) is None


def test_photos_in_several_folders_or_none_are_no_data_set(tmp_path):
    pictures(tmp_path / "one", ["a.png"])
    pictures(tmp_path / "two", ["b.png"])
    transforms(tmp_path / "transforms.json", ["one/a.png", "two/b.png"])
    assert data_set(tmp_path) is None
    transforms(tmp_path / "transforms.json", ["three/a.png"])
    assert data_set(tmp_path) is None
    assert data_set(tmp_path / "not there") is None and data_set(tmp_path / "transforms.json") is None


def test_a_frame_never_leads_out_of_the_folder(tmp_path):
    pictures(tmp_path / "outside", ["a.png"])
    (tmp_path / "set").mkdir()
    transforms(tmp_path / "set" / "transforms.json", ["../outside/a.png"])
    assert data_set(tmp_path / "set") is None


def test_a_run_takes_photos_and_cameras_and_says_so(tmp_path):
    notes = Notes()
    run = with_data_set(ReconstructSettings(nerf(tmp_path), tmp_path / "out"), notes)
    assert (run.photos, run.cameras) == (tmp_path / "train", tmp_path / "transforms_train.json")
    (said,) = notes.notes
    assert "'train'" in said and "'transforms_train.json'" in said and "'transforms_test.json' are not used" in said


def test_cameras_that_are_given_come_first_and_ordinary_photos_are_left_alone(tmp_path):
    notes = Notes()
    mine = ReconstructSettings(nerf(tmp_path), tmp_path / "out", cameras=tmp_path / "mine.json")
    assert with_data_set(mine, notes).cameras == tmp_path / "mine.json"
    plain = ReconstructSettings(tmp_path / "train", tmp_path / "out")
    assert with_data_set(plain, notes) is plain and len(notes.notes) == 1
