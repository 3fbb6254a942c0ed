"""A new format is its file and one line in a table: whoever reads or writes finds it there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.camera import Camera
from dgs.core.cloud import GaussianCloud
from dgs.core.errors import FormatError
from dgs.core.formats import cameras as camera_files
from dgs.core.formats import gaussians as splat_files
from dgs.core.formats.cameras import CAMERA_FORMATS, read_cameras
from dgs.core.formats.colmap import write_model
from dgs.core.formats.gaussians import SPLAT_FORMATS, read_gaussians, write_gaussians, written_formats
from dgs.core.formats.spec import CameraFormatSpec, FormatSpec, LensesAndPoses
from dgs.core.formats.transforms import write_transforms
from dgs.core.lens import Lens
from dgs.core.pose import Pose
from dgs.core.views import SparsePoints
from PIL import Image

PARTS = ("means", "log_scales", "quaternions", "opacity_logits", "sh")


def read_toy(path: Path) -> GaussianCloud:
    with np.load(path) as parts:
        return GaussianCloud(*(parts[name] for name in PARTS))


def write_toy(path: Path, cloud: GaussianCloud) -> None:
    with path.open("wb") as file:
        np.savez(file, **{name: getattr(cloud, name) for name in PARTS})


TOY = FormatSpec("Toy", (".toy", ".toybox"), "Every value, for nobody", read_toy, write_toy)


def read_toy_cameras(file: Path, _sizes: Mapping[str, tuple[int, int]]) -> LensesAndPoses:
    poses = {name: Pose(np.eye(3), np.array(place)) for name, place in json.loads(file.read_text()).items()}
    return dict.fromkeys(poses, Lens("SIMPLE_PINHOLE", 32, 24, (30.0, 16.0, 12.0))), poses


TOY_CAMERAS = CameraFormatSpec(
    "toy", "toy cameras", (".toycam",), lambda path: path if path.suffix == ".toycam" else None, read_toy_cameras
)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splat_files, "SPLAT_FORMATS", (*SPLAT_FORMATS, TOY))
    monkeypatch.setattr(camera_files, "CAMERA_FORMATS", (*CAMERA_FORMATS, TOY_CAMERAS))


@pytest.fixture
def cloud() -> GaussianCloud:
    random = np.random.default_rng(3)
    means = random.uniform(-0.5, 0.5, (40, 3)) + (0.0, 0.0, 4.0)
    return GaussianCloud(
        means.astype(np.float32),
        np.full((40, 3), -2.0, np.float32),
        random.normal(size=(40, 4)).astype(np.float32),
        np.full(40, 2.0, np.float32),
        random.uniform(-1, 1, (40, 1, 3)).astype(np.float32),
    )


def test_formats_do_not_share_names_or_suffixes() -> None:
    suffixes = [suffix for spec in SPLAT_FORMATS for suffix in spec.suffixes]
    assert len(set(suffixes)) == len(suffixes) and all(s.startswith(".") and s == s.lower() for s in suffixes)
    for spec in SPLAT_FORMATS:
        assert spec.name and spec.holds and not spec.holds.endswith(".")
    assert len({spec.name for spec in CAMERA_FORMATS}) == len(CAMERA_FORMATS)


@pytest.mark.parametrize("spec", written_formats(), ids=lambda spec: spec.name)
def test_what_is_written_is_read_again(spec: FormatSpec, cloud: GaussianCloud, tmp_path: Path) -> None:
    write_gaussians(tmp_path / f"twin{spec.suffixes[0].upper()}", cloud)
    back = read_gaussians(tmp_path / f"twin{spec.suffixes[0].upper()}")
    np.testing.assert_allclose(back.means, cloud.means, atol=1e-5)


def test_a_new_splat_format_is_read_written_and_named(toy: None, cloud: GaussianCloud, tmp_path: Path) -> None:
    write_gaussians(tmp_path / "twin.toy", cloud)
    assert read_gaussians(tmp_path / "twin.toy").sh.tobytes() == cloud.sh.tobytes()
    with pytest.raises(FormatError, match=r"\.ply.*\.toy, \.toybox"):
        read_gaussians(tmp_path / "twin.obj")


def test_a_format_that_is_read_only_says_what_to_write(monkeypatch: pytest.MonkeyPatch, cloud: GaussianCloud) -> None:
    fixed = FormatSpec("Fixed", (".fixed",), "Nothing", read_toy, None)
    monkeypatch.setattr(splat_files, "SPLAT_FORMATS", (*SPLAT_FORMATS, fixed))
    with pytest.raises(FormatError, match=r"Fixed is read only.*\.ply"):
        write_gaussians(Path("twin.fixed"), cloud)


def test_a_new_camera_format_is_found_and_named(toy: None, tmp_path: Path) -> None:
    (tmp_path / "a.toycam").write_text('{"b.png": [0, 0, 1], "a.png": [0, 0, 0]}')
    model = read_cameras(tmp_path / "a.toycam")
    assert model.spec is TOY_CAMERAS and list(model.pinholes()) == ["a.png", "b.png"]
    assert len(model.points().positions) == 0
    with pytest.raises(FormatError, match=r"COLMAP model, poses_bounds.npy, toy cameras"):
        read_cameras(tmp_path)
    (tmp_path / "none.toycam").write_text("{}")
    with pytest.raises(FormatError, match="places no camera"):
        read_cameras(tmp_path / "none.toycam")


@pytest.mark.parametrize("place", ["", "transforms.json", "sparse/0", "sparse/0/images.bin"])
def test_cameras_are_found_in_a_folder_and_in_a_file(place: str, tmp_path: Path) -> None:
    camera = Camera("a.png", 32, 24, 30.0, 30.0, 16.0, 12.0, np.eye(3), np.array([0.0, 0.0, 1.0]))
    points = SparsePoints(np.ones((2, 3)), np.ones((2, 3), np.uint8))
    write_model(tmp_path / "sparse" / "0", {"a.png": camera}, points)
    write_transforms(tmp_path / "transforms.json", {"a.png": camera})
    model = read_cameras(tmp_path / place)
    colmap = place.startswith("sparse")
    assert model.spec.name == ("colmap" if colmap else "transforms.json")
    assert len(model.points().positions) == (2 if colmap else 0)
    np.testing.assert_allclose(model.pinholes()["a.png"].translation, [0, 0, 1], atol=1e-12)


def test_cameras_that_are_not_there_are_explained(tmp_path: Path) -> None:
    for missing in ("nothing", "nothing.bin", "nothing.json"):
        with pytest.raises(FormatError, match=missing):
            read_cameras(tmp_path / missing)


@pytest.mark.parametrize("suffix", [".toy", ".ply", ".glb", ".spz", ".splat"])
def test_render_takes_every_format(toy: None, suffix: str, cloud: GaussianCloud, tmp_path: Path) -> None:
    write_gaussians(tmp_path / f"twin{suffix}", cloud)
    (tmp_path / "a.toycam").write_text('{"a.png": [0, 0, 0]}')
    words = ["--cameras", str(tmp_path / "a.toycam"), "--out", str(tmp_path / "out"), "--progress", "none"]
    assert run(["render", str(tmp_path / f"twin{suffix}"), *words]) == 0
    with Image.open(tmp_path / "out" / "a.png") as image:
        assert image.size == (32, 24) and np.asarray(image).any()
