"""Lenses lose a distortion that the photos do not call for, and keep one that they do."""

from __future__ import annotations

from typing import Any

import pycolmap
import pytest
from dgs.core.sfm.settings import RefineSettings
from dgs.core.sfm.straight import with_straight_lenses


def model(true: float, found: float) -> Any:
    """A set photographed through distortion `true`, adjusted from a start at `found`; 0.1 px of noise."""
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 12
    options.num_points3D = 300
    options.camera_width, options.camera_height = 800, 600
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [3000.0, 400.0, 300.0, true]  # the points fill the frame
    out = pycolmap.synthesize_dataset(options)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.1
    pycolmap.synthesize_noise(noise, out)
    for camera in out.cameras.values():
        camera.params = [*camera.params[:3], found]
    for number in [n for n, point in out.points3D.items() if point.track.length() < 3]:
        out.delete_point3D(number)
    pycolmap.bundle_adjustment(out, pycolmap.BundleAdjustmentOptions())
    return out


@pytest.mark.parametrize(("true", "straight"), [(0.0, True), (0.1, False), (-0.1, False), (0.5, False)])
def test_only_what_is_called_for(true: float, straight: bool) -> None:
    before = model(true, true + 0.02)
    after = with_straight_lenses(before, RefineSettings())
    (lens,) = after.cameras.values()
    assert bool(lens.params[3] == 0.0) is straight
    if not straight:
        assert after is before and abs(lens.params[3] - true) < 0.05
    assert lens.params[0] == pytest.approx(3000.0, rel=5e-3)


def test_errors_that_a_model_remembers_do_not_decide() -> None:
    before = model(0.0, 0.02)
    for point in before.points3D.values():
        point.error = 0.0
    (lens,) = with_straight_lenses(before, RefineSettings()).cameras.values()
    assert lens.params[3] == 0.0
