"""One step of a camera towards its photo: Gauss and Newton's, through the blur.

The residual of a photo y is r = y - H R(pose), with the twin's render R and the blur H. A pose moves by a twist in
its camera's own axes (R, t) -> exp(twist) o (R, t); columns of the Jacobian are differences of blurred renders.
Steps of many cameras with their points are in `adjust`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from torch import Tensor

from ...camera import Camera
from ...numbers import BY_DEFINITION, number

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PoseStepSettings:
    """Numbers of one step of a camera."""

    difference: float = number(
        0.25,
        "px of the frame",
        "length of a difference that stands for a derivative: well inside a splat, well above float32's noise",
    )
    prior: float = number(
        10.0, "px", "standard deviation of the prior, which holds a camera weakly where it was; smaller holds it more"
    )
    longest: float = number(3.0, "px", "a step is cut to this: beyond, the render says little about the way")
    huber: float = number(
        1.345,
        "standard deviations",
        "residuals beyond count with their size, not their square: what moved or shines does not outvote the rest"
        " (Huber's constant, 95 % efficient on normal noise)",
        BY_DEFINITION,
    )


SETTINGS = PoseStepSettings()


def twisted(camera: Camera, twist: Floats) -> Camera:
    """The camera moved by exp(twist) in its own axes; twist [6]: translation, then rotation (radians).

    Rotation and translation are composed one after the other, which differs from the exponential in second order.
    """
    turn = Rotation.from_rotvec(twist[3:]).as_matrix()
    return camera.moved(turn @ camera.rotation, turn @ camera.translation + twist[:3])


def units_of(camera: Camera) -> Floats:
    """[6] what one px is, in units of a twist; along the view a camera moves twice as far for a px."""
    px = 1.0 / camera.fx
    return np.array([px, px, 2 * px, px, px, 2.0 / camera.width])


def _smoothed(planes: Tensor, size: float) -> Tensor:
    """[3, H, W] smoothed by a Gaussian of `size` px."""
    if size <= 0.0:
        return planes
    return torch.from_numpy(gaussian_filter(planes.numpy(), (0.0, size, size), truncate=3.0))


def photometric_step(
    camera: Camera,
    photo: Tensor,
    valid: Tensor | None,
    predict: Callable[[Camera], Tensor],
    smooth: float = 0.0,
    settings: PoseStepSettings = SETTINGS,
) -> Floats:
    """The twist [6] that takes the camera towards where its photo was taken.

    Args:
        camera: on the grid, scene's own units (viewing distance about 1).
        photo: [3, H, W] sRGB; valid: [H, W] bool or None.
        predict: camera -> [3, H, W], what the photo would be.
        smooth: px by which both are smoothed: a step is true only within the size of the detail it looks at.
    """
    units = units_of(camera)
    with torch.no_grad():
        base = predict(camera)
        residual = photo - base
        if valid is not None:
            residual = torch.where(valid, residual, 0.0)
        residual = _smoothed(residual, smooth)
        columns = []
        for index in range(6):
            twist = np.zeros(6)
            twist[index] = settings.difference * units[index]
            columns.append(_smoothed((predict(twisted(camera, twist)) - base) / settings.difference, smooth))
        jacobian = torch.stack(columns).flatten(1).double()
        r = residual.flatten().double()
        limit = max(settings.huber * 1.4826 * float(r.abs().median()), 1e-4)
        weight = (limit / r.abs().clamp(min=1e-12)).clamp(max=1.0)
        if valid is not None:
            weight = weight * valid.expand(3, -1, -1).flatten()
        weighted = jacobian * weight
        noise = max(float((weight * r.square()).sum() / weight.sum().clamp(min=1.0)), 1e-8)
        matrix, vector = (weighted @ jacobian.T).numpy() / noise, (weighted @ r).numpy() / noise
    step = np.linalg.inv(matrix + 1.0 / settings.prior**2 * np.eye(6)) @ vector
    longest = float(np.abs(step).max())
    return np.asarray(step * min(1.0, settings.longest / max(longest, 1e-12)) * units)
