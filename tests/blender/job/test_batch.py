"""Several folders of photos from the panel: a real engine, one set that is finished, one that fails."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.command_line.batch_command import add_arguments  # noqa: E402
from dgs.core.errors import DgsError  # noqa: E402
from dgs.dgs_addon.job import batch  # noqa: E402
from dgs.dgs_addon.scene.twin import is_twin  # noqa: E402
from dgs.panels import DGS_PT_optimize  # noqa: E402
from dgs.studies.stability.fuzzed_state import write_twin  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402


@pytest.fixture
def sets(tmp_path: Path) -> Iterator[Path]:
    """cup is finished, hat has photos that are none of one scene, notes holds no photos."""
    dgs.register()
    write_twin(tmp_path / "made")
    parent = tmp_path / "sets"
    for name in ("cup", "hat"):
        shutil.copytree(tmp_path / "made" / "photos", parent / name)
        shutil.copyfile(parent / name / "a.png", parent / name / "c.png")
    shutil.copytree(tmp_path / "made" / "twin", parent / "cup-twin")
    report = {"status": "done", "gaussians": 9, "photos": {"registered": 3, "given": 3}}
    report |= {"heldout": {"degraded": {"psnr": 28.5}}, "seconds": {"total": 60.0}}
    (parent / "cup-twin" / "report.json").write_text(json.dumps(report))
    (parent / "notes").mkdir()
    (parent / "notes" / "a.txt").write_text("no photos")
    bpy.context.scene.dgs.preset, bpy.context.scene.dgs.max_gaussians = "draft", 200
    bpy.context.scene.dgs.effects = "none"
    yield parent
    dgs.unregister()


def test_folders_with_photos_are_sets(sets: Path) -> None:
    assert [path.name for path in batch.photo_sets(sets)] == ["cup", "hat"]
    with pytest.raises(DgsError, match="holds photos"):
        batch.absolute_sets(str(sets / "notes"))
    with pytest.raises(DgsError, match="cannot be read"):
        batch.photo_sets(sets / "nowhere")


def test_each_set_gets_its_line_and_twins_can_be_added(sets: Path) -> None:
    with pytest.raises(RuntimeError, match="1 of 2 failed"):
        bpy.ops.dgs.batch(directory=str(sets))
    done = batch.current()
    assert done is not None and [line["how"] for line in done.lines] == ["done before", "failed"]
    paper = drawn(DGS_PT_optimize)
    assert "cup" in paper.words and f"hat: {done.lines[1]['why']}"[:20] in paper.words.replace("\n", " ")
    assert [button.number for button in paper.buttons["dgs.take_set"]] == [0]
    assert bpy.ops.dgs.take_set(number=0) == {"FINISHED"}
    assert bpy.context.scene.dgs.photos == str(sets / "cup")
    assert any(is_twin(thing) for thing in bpy.context.scene.objects)


def test_it_is_cancelled_and_ends_with_the_add_on(sets: Path) -> None:
    folders = batch.absolute_sets(str(sets))
    shutil.rmtree(sets / "cup-twin")
    begun = batch.start(folders, bpy.context.scene.dgs, Path(shutil.which("python3") or "python3"))
    with pytest.raises(RuntimeError, match="A job is running"):
        bpy.ops.dgs.batch(directory=str(sets))
    batch.cancel()
    batch.cancel()  # at once
    assert batch.wait(30) and not begun.lines
    assert "before any twin" in drawn(DGS_PT_optimize).words or begun.error


def test_every_option_is_one_of_the_command(sets: Path) -> None:
    settings: Any = bpy.context.scene.dgs
    settings.medium, settings.sigma, settings.threads, settings.time_limit = "gaussian", 2.0, 2, 1.5
    settings.adjust_cameras = "never"
    settings.refine_cameras, settings.sh_degree, settings.max_size, settings.background = True, "1", 400, "white"
    command = batch.batch_command(Path("python"), [sets / "cup"], batch.shared_options(settings))
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    parsed = parser.parse_args(command[3:])
    assert (
        parsed.photos == [sets / "cup"]
        and parsed.time_limit == 90.0
        and parsed.refine_cameras
        and parsed.adjust_cameras == "never"
    )
    assert (parsed.psf, parsed.threads, parsed.sh_degree, parsed.max_size) == ("gaussian:2", 2, 1, 400)
    assert (parsed.max_gaussians, parsed.background, parsed.preset, parsed.control) == (200, "white", "draft", True)
