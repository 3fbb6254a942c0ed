"""Photos with their cameras, as other programs write them: chosen, dropped or typed, they become both."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.formats.cameras import read_cameras  # noqa: E402
from dgs.dgs_addon.job.batch import photo_sets  # noqa: E402
from dgs.dgs_addon.job.request import request_of  # noqa: E402
from dgs.dgs_addon.paths import out_folder  # noqa: E402
from dgs.operators import DGS_FH_data_set  # noqa: E402
from dgs.panels import DGS_PT_cameras  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402
from dgs.tests.core.photos.test_data_set import colmap, nerf, pictures, transforms  # noqa: E402


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


@pytest.fixture
def settings() -> Any:
    return bpy.context.scene.dgs


def more(root: Path, folder: str) -> Path:
    """A third photo, as the panel wants three."""
    first = min((root / folder).iterdir())
    shutil.copy(first, first.with_stem("c"))
    return root


def three(root: Path) -> Path:
    """As NeRF's synthetic scenes, with three photos."""
    more(nerf(root), "train")
    (root / "train" / "c.png").rename(root / "train" / "r_2.png")
    transforms(root / "transforms_train.json", [f"./train/r_{number}" for number in range(3)])
    return root


def came(settings: Any) -> tuple[str, str, str]:
    return settings.photos, settings.cameras, settings.model


@pytest.fixture
def said(capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What the button reports, as Blender prints it where there is no window."""

    def choose(directory: Path, *names: str) -> str:
        capfd.readouterr()
        bpy.ops.dgs.choose_photos(directory=str(directory), files=[{"name": name} for name in names])
        return capfd.readouterr().out.strip()

    return choose


def test_a_chosen_data_set_brings_photos_and_cameras(tmp_path: Path, settings: Any) -> None:
    root = three(tmp_path / "lego")
    assert bpy.ops.dgs.choose_photos(directory=str(root)) == {"FINISHED"}
    assert came(settings) == (str(root / "train"), "model", str(root / "transforms_train.json"))
    request = request_of("reconstruct", bpy.context.scene)
    assert request.photos == root / "train" and request.count == 3
    assert request.options["cameras"] == str(root / "transforms_train.json")
    sizes = {f"r_{number}": (16, 12) for number in range(3)}
    assert len(read_cameras(Path(str(request.options["cameras"])), sizes).poses) == 3
    assert "They came with the photos" in drawn(DGS_PT_cameras).words


def test_the_button_names_both(tmp_path: Path, said: Callable[..., str]) -> None:
    root = more(colmap(tmp_path / "garden"), "images")
    assert said(root) == f"Info: 3 photos of 'images', with the cameras of '{Path('sparse', '0')}'"


def test_a_typed_path_is_as_good(tmp_path: Path, settings: Any) -> None:
    root = more(colmap(tmp_path / "garden"), "images")
    settings.photos = str(root)
    assert came(settings) == (str(root / "images"), "model", str(root / "sparse" / "0"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.context.scene.dgs.photos = "//garden"
    assert came(bpy.context.scene.dgs) == ("//garden/images", "model", "//garden/sparse/0")
    assert out_folder(bpy.context.scene.dgs) == root / "images-twin"


def test_a_dropped_file_of_cameras_brings_its_photos(tmp_path: Path, settings: Any, said: Callable[..., str]) -> None:
    root = three(tmp_path / "lego")
    assert DGS_FH_data_set.bl_import_operator == "dgs.choose_photos"
    words = said(root, "transforms_train.json")
    assert words == "Info: 3 photos of 'train', with the cameras of 'transforms_train.json'"
    flat = tmp_path / "flat"
    pictures(flat, ["a.png", "b.png", "c.png"])
    transforms(flat / "poses.json", ["a.png", "b.png", "c.png"])
    (flat / "notes.json").write_text(json.dumps({"frames": 3}))
    assert said(flat, "poses.json") == "Info: 3 photos of 'flat', with the cameras of 'poses.json'"
    assert came(settings) == (str(flat), "model", str(flat / "poses.json"))
    said(flat, "a.png")
    assert came(settings) == (str(flat), "model", str(flat / "poses.json")), "the same photos keep their cameras"
    settings.cameras = "photos"
    assert said(flat, "notes.json") == "Info: 3 photos"
    assert came(settings)[1] == "photos", "no cameras"


def test_other_photos_do_not_keep_the_cameras(tmp_path: Path, settings: Any) -> None:
    root = three(tmp_path / "lego")
    pictures(tmp_path / "cup", ["a.png", "b.png", "c.png"])
    settings.photos = str(root)
    settings.photos = str(root / "train")
    assert came(settings)[1:] == ("model", str(root / "transforms_train.json")), "they are its own"
    settings.photos = str(tmp_path / "cup")
    assert came(settings) == (str(tmp_path / "cup"), "photos", "")
    settings.cameras, settings.model = "model", str(tmp_path / "mine.json")
    settings.photos = str(root / "train")
    assert came(settings) == (str(root / "train"), "model", str(tmp_path / "mine.json")), "what the user named stays"


def test_data_sets_count_as_sets_of_photos(tmp_path: Path) -> None:
    three(tmp_path / "lego")
    more(colmap(tmp_path / "garden"), "images")
    colmap(tmp_path / "few")
    pictures(tmp_path / "cup", ["a.png", "b.png", "c.png"])
    (tmp_path / "notes").mkdir()
    assert [path.name for path in photo_sets(tmp_path)] == ["cup", "garden", "lego"]
