"""One step of all cameras towards the photos: Gauss and Newton's, through the blur.

For each photo y and its twin's render R the residual is r = y - H R(pose, focal). A pose moves by a
twist in its camera's own axes (R, t) -> exp(twist) o (R, t); columns of the Jacobian are differences of blurred
renders. The focal length is shared: it is solved for together with all poses by Schur's complement.
Photos cannot tell where the world lies, how it is turned and how large it is: that part of the step is taken out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from torch import Tensor

from ..camera import Camera

#: Length of a difference in px of the frame: well inside a splat, well above float32's noise.
DIFFERENCE = 0.25
#: What a camera may be off before it is doubted, px, and the focal length, relative: a weak pull to where they were.
LOOSE, LOOSE_FOCAL = 10.0, 0.05
#: A step is cut to this many px: beyond, the render says little about the way.
LONGEST = 3.0
#: And to this change of the focal length: it hides behind the distance, and runs away if it may.
LONGEST_FOCAL = 0.005

Floats = NDArray[np.float64]


def twisted(camera: Camera, twist: Floats) -> Camera:
    """The camera moved by exp(twist) in its own axes; twist [6]: translation, then rotation (radians).

    Rotation and translation are composed one after the other, which differs from the exponential in second order.
    """
    turn = Rotation.from_rotvec(twist[3:]).as_matrix()
    return camera.moved(turn @ camera.rotation, turn @ camera.translation + twist[:3])


def zoomed(camera: Camera, share: float) -> Camera:
    """The camera with its focal lengths times exp(share)."""
    return replace(camera, fx=camera.fx * np.exp(share), fy=camera.fy * np.exp(share))


def _smoothed(planes: Tensor, size: float) -> Tensor:
    """[3, H, W] smoothed by a Gaussian of `size` px."""
    if size <= 0.0:
        return planes
    return torch.from_numpy(gaussian_filter(planes.numpy(), (0.0, size, size), truncate=3.0))


@dataclass(frozen=True)
class Equations:
    """One photo's share of the normal equations, in px: 6 rows of the pose, the last of the focal length.

    Attributes:
        matrix: [7, 7], vector: [7], of unit weight.
        squares: mean squared residual.
        units: [7] what one px is, in units of the parameters.
        count: px times channels.
    """

    matrix: Floats
    vector: Floats
    squares: float
    units: Floats
    count: int


def equations(
    camera: Camera,
    photo: Tensor,
    valid: Tensor | None,
    look: Callable[[Camera], Tensor],
    with_focal: bool = True,
    smooth: float = 0.0,
) -> Equations:
    """The photo's pull at its camera.

    Args:
        camera: on the grid, scene's own units (viewing distance about 1).
        photo: [3, H, W] sRGB; valid: [H, W] bool or None.
        look: camera -> [3, H, W], what the photo would be.
        smooth: px by which both are smoothed: a step is true only within the size of the detail it looks at.
    """
    px = 1.0 / camera.fx
    # A zoom by s moves the frame's edge by s times half its width.
    units = np.array([px, px, 2 * px, px, px, 2.0 / camera.width, 2.0 / camera.width])
    with torch.no_grad():
        base = look(camera)
        residual = photo - base
        if valid is not None:
            residual = torch.where(valid, residual, 0.0)
        residual = _smoothed(residual, smooth)
        columns = []
        for index in range(7 if with_focal else 6):
            size = DIFFERENCE * units[index]
            if index < 6:
                twist = np.zeros(6)
                twist[index] = size
                moved = twisted(camera, twist)
            else:
                moved = zoomed(camera, size)
            columns.append(_smoothed((look(moved) - base) / DIFFERENCE, smooth))
        if not with_focal:
            columns.append(torch.zeros_like(base))
        jacobian = torch.stack(columns).flatten(1).double()
        r = residual.flatten().double()
        # Huber's weights: what moved or shines does not outvote the rest.
        size = max(1.345 * 1.4826 * float(r.abs().median()), 1e-4)
        weight = (size / r.abs().clamp(min=1e-12)).clamp(max=1.0)
        if valid is not None:
            weight = weight * valid.expand(3, -1, -1).flatten()
        weighted = jacobian * weight
        return Equations(
            (weighted @ jacobian.T).numpy(),
            (weighted @ r).numpy(),
            float((weight * r.square()).sum() / weight.sum().clamp(min=1.0)),
            units,
            int(weight.numel()),
        )


def solved(pulls: Sequence[Equations], focal: bool, drift: Sequence[Floats]) -> tuple[list[Floats], float]:
    """Twists [6] of all cameras and the logarithm of the focal length's change.

    Args:
        pulls: of every camera; focal: whether the focal length may change.
        drift: [6] how far (px) each camera is from where it began, which the weak pull answers.
    """
    doubt = 1.0 / LOOSE**2
    whole, right = 0.0, 0.0
    parts = []
    for pull, before in zip(pulls, drift, strict=True):
        noise = max(pull.squares, 1e-8)
        a = pull.matrix / noise
        b = pull.vector / noise
        corner = np.linalg.inv(a[:6, :6] + doubt * np.eye(6))
        head = b[:6] - doubt * before
        parts.append((corner, head, a[:6, 6]))
        whole += a[6, 6] - a[6, :6] @ corner @ a[:6, 6]
        right += b[6] - a[6, :6] @ corner @ head
    unit = float(pulls[0].units[6])
    change = 0.0
    if focal:
        change = float(right / (whole + (unit / LOOSE_FOCAL) ** 2))
        change = float(np.clip(change, -LONGEST_FOCAL / unit, LONGEST_FOCAL / unit))
    twists = []
    for (corner, head, tie), pull in zip(parts, pulls, strict=True):
        step = corner @ (head - tie * change)
        longest = float(np.abs(step).max())
        twists.append(step * min(1.0, LONGEST / max(longest, 1e-12)) * pull.units[:6])
    return twists, change * unit


def without_gauge(before: Sequence[Camera], after: Sequence[Camera]) -> list[Camera]:
    """`after` without the similarity that lays it off `before`: the world keeps its place, turn and size."""
    from ..evaluation.poses import align_similarity

    if len(before) < 2:
        return list(after)
    name = lambda cameras: {str(i): c for i, c in enumerate(cameras)}  # noqa: E731
    similarity = align_similarity(name(after), name(before))
    return [similarity.camera(camera) for camera in after]
