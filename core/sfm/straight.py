"""Bundle adjustment's options, and lenses without distortion where the photos call for no other.

Runs in the child process only.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..colmap_library import pycolmap
from ..numbers import number
from .settings import RefineSettings


@dataclass(frozen=True)
class StraightLensSettings:
    """When lenses count as free of distortion."""

    largest_shift: float = number(
        2.0, "px", "lenses that move a photo's corner by more than this are not tried without distortion"
    )
    largest_loss: float = number(
        0.01,
        "share",
        "by which the mean reprojection error may grow without distortion: a hundredth of a tenth of a pixel",
        "ball, rendered without distortion: 0.2 %",
    )


SETTINGS = StraightLensSettings()


def adjustment(settings: RefineSettings) -> Any:
    """Options of a bundle adjustment with a robust loss."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = 0.5 * settings.inlier
    options.ceres.solver_options.num_threads = 1  # sums of several threads differ from run to run
    options.ceres.solver_options.max_num_iterations = settings.iterations
    options.ceres.solver_options.function_tolerance = settings.tolerance
    return options


def with_straight_lenses(model: Any, settings: RefineSettings) -> Any:
    """The model with lenses that do not bend light, if they explain the photos as well.

    A coefficient that nothing calls for bends every photo by parts of a pixel: undoing that takes time and
    interpolation, for nothing.

    Args:
        model: pycolmap.Reconstruction after bundle adjustment.

    Returns:
        A new reconstruction, or `model` itself where its lenses are called for.
    """
    for camera in model.cameras.values():
        width, height, focal = camera.width, camera.height, camera.mean_focal_length()
        corner = np.hypot(width, height) / 2.0 / focal
        if camera.model.name != "SIMPLE_RADIAL" or abs(camera.params[3]) * corner**3 * focal > SETTINGS.largest_shift:
            return model
    straight = copy.deepcopy(model)
    for camera in straight.cameras.values():
        camera.params = [*camera.params[:3], 0.0]
    options = adjustment(settings)
    options.refine_extra_params = False
    pycolmap.bundle_adjustment(straight, options)
    for each in (model, straight):
        each.update_point_3d_errors()
    errors = [each.compute_mean_reprojection_error() for each in (model, straight)]
    return straight if errors[1] <= errors[0] * (1.0 + SETTINGS.largest_loss) else model
