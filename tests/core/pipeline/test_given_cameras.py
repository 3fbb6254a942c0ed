"""Cameras that are given with shaken photos: whole runs that believe them, and that do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.core.formats.cameras import read_cameras
from dgs.core.imaging.medium import Medium
from dgs.core.photos.load import load_photos
from dgs.core.pipeline.adjusted import adjusts
from dgs.core.pipeline.cameras import CameraSearch, FoundCameras, cameras_of
from dgs.core.pipeline.reconstruct import reconstruct
from dgs.core.progress import Silent
from dgs.core.run_settings import AdjustCameras, ReconstructSettings
from dgs.core.sfm.given import load_cameras
from dgs.core.sfm.settings import SfmSettings
from dgs.core.training import settings
from dgs.core.twin.folder import TwinFolder
from dgs.tests.command_line.scene import write_scene


def test_what_is_asked_for_decides_and_whether_cameras_were_found() -> None:
    assert [adjusts("auto", found) for found in (True, False)] == ["always", "contradicted"]
    assert [adjusts("never", found) for found in (True, False)] == ["never", "never"]
    assert [adjusts("always", found) for found in (True, False)] == ["always", "always"]


@pytest.mark.parametrize("from_photos", [True, False])
def test_refined_cameras_of_a_resumed_run_come_from_where_given_ones_came_from(
    tmp_path: Path, from_photos: bool
) -> None:
    write_scene(tmp_path)
    photos = load_photos(tmp_path / "photos", None, Silent())
    cameras = load_cameras(tmp_path / "model", photos)
    given = FoundCameras(replace(cameras, figures=replace(cameras.figures, from_photos=from_photos)), "given")
    folder, search = TwinFolder(tmp_path / "out"), CameraSearch(SfmSettings(), resume=True, refined=True)
    folder.save_cameras(cameras)
    found = cameras_of(given, photos, Medium(), search, folder, Silent())
    assert found.reconstruction.figures.from_photos is from_photos and found.source == "given"


@pytest.mark.parametrize(
    ("adjust", "doubted", "moves"), [("auto", False, False), ("auto", True, True), ("always", False, True)]
)
def test_given_cameras_are_moved_if_photos_contradict_them_or_as_asked(
    tmp_path: Path, monkeypatch, adjust: AdjustCameras, doubted: bool, moves: bool
) -> None:
    write_scene(tmp_path)
    out, asked = tmp_path / "out", []
    monkeypatch.setattr("dgs.core.training.cameras.moving.contradicted", lambda *_: asked.append(1) or doubted)
    monkeypatch.setattr(settings, "PRESETS", replace(settings.PRESETS, draft_steps=80))
    words = {"cameras": tmp_path / "model", "effects": "motion", "preset": "draft", "max_gaussians": 500}
    run = ReconstructSettings(tmp_path / "photos", out, holdout_every=4, adjust_cameras=adjust, **words).split()
    notes = reconstruct(run, Silent()).report["notes"]
    assert len(asked) == (adjust == "auto"), "once in a run, and only if the photos are to decide"
    given, kept = (read_cameras(place).pinholes() for place in (tmp_path / "model", out / "cameras"))
    moved = max(np.abs(kept[name].translation - camera.translation).max() for name, camera in given.items())
    assert (moved > 1e-4) == moves
    assert (out / "cameras" / "found").is_dir() == moves
    assert any("are contradicted by the photos" in note for note in notes) == (adjust == "auto" and moves)
    assert any("cameras/found" in note for note in notes) == moves
