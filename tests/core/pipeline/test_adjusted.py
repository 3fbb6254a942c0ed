"""Cameras that a training adjusted take the place of those that were found; a run that goes on goes on from these."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from dgs.core.formats.cameras import read_cameras
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import CameraMotion
from dgs.core.lens import Lens
from dgs.core.pipeline.adjusted import adjustment_said, keep_adjusted
from dgs.core.pose import Pose
from dgs.core.reconstruction import Figures, Reconstruction, no_points
from dgs.core.twin.folder import TwinFolder

LENS = Lens("PINHOLE", 96, 80, (110.0, 110.0, 48.0, 40.0))
FOUND = Reconstruction(
    {name: Pose(np.eye(3), np.array([x, 0.0, 3.0])) for name, x in (("a.png", 0.0), ("b.png", 0.5))},
    {"a.png": LENS, "b.png": LENS},
    no_points(),
    Figures("sfm", 2, 2, 110.0, 0.5, 20.0, 1.0),
)


def trained(adjusted: int) -> SimpleNamespace:
    twists = torch.zeros(2, 3, 6)
    twists[0, 0, 0] = 0.2
    counters = {"cameras adjusted": adjusted} if adjusted else {}
    return SimpleNamespace(formation=Formation([CameraMotion(["a.png", "b.png"], twists)]), counters=counters)


def places(folder: Path) -> dict[str, float]:
    return {name: float(camera.translation[0]) for name, camera in read_cameras(folder).pinholes().items()}


def test_it_is_said_how_far_given_cameras_are_off():
    assert adjustment_said(FOUND, trained(0)) is None
    said = adjustment_said(FOUND, trained(5))
    # (one of two cameras moved 0.2 aside, of a unit that is one away: 22 px at a focal length of 110)
    assert said is not None and "by 11.0 px in the median, 22.0 at most" in said


def test_adjusted_cameras_stand_beside_the_twin(tmp_path):
    folder = TwinFolder(tmp_path)
    folder.save_cameras(FOUND)
    formation = keep_adjusted(FOUND, trained(5), folder)
    assert places(folder.camera_folder) == pytest.approx({"a.png": 0.2, "b.png": 0.5}, abs=1e-6)
    assert places(folder.found_cameras) == {"a.png": 0.0, "b.png": 0.5}
    assert float(formation.motion.parameters["twists"].abs().max()) < 1e-7, "counted from where they are now"


def test_cameras_that_were_not_adjusted_stay(tmp_path):
    folder = TwinFolder(tmp_path)
    folder.save_cameras(FOUND)
    run = trained(0)
    assert keep_adjusted(FOUND, run, folder) is run.formation
    still = SimpleNamespace(formation=Formation(), counters={"cameras adjusted": 5})
    assert keep_adjusted(FOUND, still, folder) is still.formation
    assert places(folder.camera_folder) == {"a.png": 0.0, "b.png": 0.5}
    assert not folder.found_cameras.exists()
