"""What Blender writes: never over a photo or a part of a twin's folder, and whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats.gaussians import read_gaussians, write_gaussians  # noqa: E402
from dgs.core.formats.ply import write_ply  # noqa: E402
from dgs.core.formats.transforms import read_transforms, write_transforms  # noqa: E402
from dgs.dgs_addon.laboratory.dataset import _forget_other_settings  # noqa: E402
from dgs.dgs_addon.scene.twin import read_twin  # noqa: E402
from dgs.tests.blender.test_scene_cameras import _cameras  # noqa: E402
from dgs.tests.crashes import Fault, crashes  # noqa: E402


@pytest.fixture(autouse=True)
def twin(cloud: GaussianCloud, tmp_path: Path) -> Iterator[None]:
    dgs.register()
    write_ply(tmp_path / "in.ply", cloud)
    bpy.ops.dgs.import_twin(filepath=str(tmp_path / "in.ply"))
    yield
    dgs.unregister()


def test_no_export_replaces_a_photo_or_another_input(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    for name in "abc":
        (photos / f"{name}.png").write_bytes(b"\x89PNG" + bytes(40))
    settings = bpy.context.scene.dgs
    settings.photos, settings.psf_file = str(photos), str(tmp_path / "kernel.ply")
    (tmp_path / "kernel.ply").write_bytes(b"kernel")
    (tmp_path / "link.ply").symlink_to(photos / "a.png")  # whatever it is called
    for name in ("kernel.ply", "link.ply"):
        before = (tmp_path / name).read_bytes()
        with pytest.raises(RuntimeError, match="a photo or another input"):
            bpy.ops.dgs.export_twin(filepath=str(tmp_path / name))
        assert (tmp_path / name).read_bytes() == before


@pytest.mark.parametrize("inside", ["twin.ply", "snapshot/twin.ply", "history/000/twin.ply", "cameras/new.ply"])
def test_no_export_replaces_a_part_of_a_twins_folder(tmp_path: Path, inside: str) -> None:
    (tmp_path / "t" / inside).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / "t" / "report.json").write_text("{}")
    (tmp_path / "t" / inside).write_bytes(b"mine")
    with pytest.raises(RuntimeError, match="the twin's own folder 't'"):
        bpy.ops.dgs.export_twin(filepath=str(tmp_path / "t" / inside))
    assert (tmp_path / "t" / inside).read_bytes() == b"mine"
    assert bpy.ops.dgs.export_twin(filepath=str(tmp_path / "t" / "mine.ply")) == {"FINISHED"}


def _export(suffix: str) -> tuple[Callable[[Path], object], Callable[[Path], object]]:
    return lambda path: write_gaussians(path, read_twin(bpy.context.object)), read_gaussians


WRITERS = {suffix: _export(suffix) for suffix in (".ply", ".glb", ".spz", ".splat")}
WRITERS[".json"] = (lambda path: write_transforms(path, _cameras()), read_transforms)


@pytest.mark.parametrize("fault", ["kill", "full"])
@pytest.mark.parametrize("suffix", WRITERS)
def test_a_kill_or_a_full_disk_leaves_the_old_file_or_the_new_one(tmp_path: Path, suffix: str, fault: Fault) -> None:
    """The part of an export that writes, in children of this Blender (of which only one thread lives on)."""
    write, read = WRITERS[suffix]
    folder = tmp_path / "folder"
    folder.mkdir()
    path, steps = folder / f"out{suffix}", 0
    write(path)
    new = path.read_bytes()
    path.write_bytes(b"the old one")
    for _ in crashes(lambda: write(path), folder, fault, dgs.core.errors.OutputError):
        steps += 1
        kept = path.read_bytes()
        assert kept in (b"the old one", new)
        leftovers = [entry.name for entry in folder.iterdir() if entry != path]
        assert all(name.startswith(".") and ".part" in name for name in leftovers), leftovers
        for name in leftovers:
            (folder / name).unlink()
        path.write_bytes(b"the old one")
    assert steps >= 1
    assert path.read_bytes() == new and read(path)
    assert os.listdir(folder) == [path.name]


def test_a_data_set_takes_away_nothing_but_its_own(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for name in ("view_000.png", "view_of_the_lake.png", "view_001.jpg", "me.png"):
        (tmp_path / "photos" / name).write_bytes(b"x")
    _forget_other_settings(tmp_path, {"render_fingerprint": "new"})
    assert sorted(os.listdir(tmp_path / "photos")) == ["me.png", "view_001.jpg", "view_of_the_lake.png"]
