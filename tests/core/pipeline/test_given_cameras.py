"""Cameras that are given with shaken photos: whole runs that believe them, and that do not."""

from pathlib import Path

import numpy as np
import pytest
from dgs.core.formats.cameras import read_cameras
from dgs.core.pipeline.reconstruct import reconstruct
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings
from dgs.tests.command_line.scene import write_scene


@pytest.mark.parametrize("doubted", [False, True])
def test_given_cameras_are_moved_if_photos_contradict_them(tmp_path: Path, monkeypatch, doubted: bool) -> None:
    write_scene(tmp_path)
    out, asked = tmp_path / "out", []
    monkeypatch.setattr("dgs.core.training.trainer.contradicted", lambda *_: asked.append(1) or doubted)
    words = {"cameras": tmp_path / "model", "effects": "motion", "preset": "draft", "max_gaussians": 500}
    run = ReconstructSettings(tmp_path / "photos", out, holdout_every=4, **words).split()
    notes = reconstruct(run, Silent()).report["notes"]
    assert len(asked) == 1, "once in a run"
    given, kept = (read_cameras(place).pinholes() for place in (tmp_path / "model", out / "cameras"))
    moved = max(np.abs(kept[name].translation - camera.translation).max() for name, camera in given.items())
    assert (moved > 1e-4) == doubted
    assert (out / "cameras" / "found").is_dir() == doubted
    assert any("contradict the cameras that were given" in note for note in notes) == doubted
