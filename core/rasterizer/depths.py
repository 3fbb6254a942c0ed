"""Where a camera's rays meet the Gaussians: depths of a view, in more ways than its training needs; no gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ..camera import Camera
from ..compiled import run
from ..errors import DeviceError
from ..gaussians import Gaussians
from ..rendering import OPAQUE_ENOUGH, RasterSettings
from .cpu import Projected, numpy_parameters, project_and_sort, view_vector
from .depth_kernels import EXPECTED, LEVEL, PLANES, SQUARE, TRANSMITTANCE, blend_depths, find_surface
from .ray_kernels import HIGH, K_M, LOW, RAY_WIDTH, place_rays
from .shape_kernels import V_ALPHA_MINIMUM

Floats = NDArray[np.float32]

#: A Gaussian is taken for at least this thick, as a share of its longest axis: thinner ones have no digits left.
_THINNEST = 1e-3
#: Standard deviations from its centre within which a Gaussian holds light back.
_REACH = 3.0


@dataclass(frozen=True)
class Depths:
    """Depths along the axis of one view, in the camera's world units.

    Attributes:
        expected: [H, W] mean over the light that is held back; NaN where next to none is.
        surface: [H, W] where a given share of the light is held back; NaN where less is held back altogether.
        spread: [H, W] standard deviation of that light's depth; NaN where `expected` is.
        alpha: [H, W] opacity.
    """

    expected: Floats
    surface: Floats
    spread: Floats
    alpha: Floats


def blended_depths(
    gaussians: Gaussians,
    camera: Camera,
    settings: RasterSettings = RasterSettings(),
    *,
    held: float = 0.5,
    centres: bool = False,
) -> Depths:
    """Depths of one view.

    Args:
        gaussians: float32 on the CPU.
        held: share of the light that is held back in front of a surface; 0.5 makes it the median.
        centres: each Gaussian is as far as its centre, as in `Rendered.depth`; otherwise as far as it is densest along
            each px's own ray.

    Raises:
        DeviceError: the tensors are elsewhere.
    """
    found = _projected(gaussians, camera, settings)
    rays = _at_centres(gaussians, camera) if centres else _rays(gaussians, camera)
    out = np.empty((PLANES, camera.height, camera.width), np.float32)
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    tiles = len(found.tile_starts) - 1
    least = np.float32(found.view[V_ALPHA_MINIMUM])
    level = np.float32(1.0 - held)
    arguments = (found.splats, rays, lens, found.tile_starts, found.pairs, least, level, found.tiles_x, out)
    run(blend_depths, tiles, *arguments, grain=4)
    alpha = 1.0 - out[TRANSMITTANCE]
    seen = alpha > OPAQUE_ENOUGH
    mean = np.where(seen, out[EXPECTED] / np.maximum(alpha, OPAQUE_ENOUGH), np.nan)
    square = out[SQUARE] / np.maximum(alpha, OPAQUE_ENOUGH)
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))
    surface = np.where(out[LEVEL] > 0, out[LEVEL], np.nan)
    return Depths(*(plane.astype(np.float32) for plane in (mean, surface, spread, alpha)))


def surface_of_centres(
    gaussians: Gaussians, camera: Camera, settings: RasterSettings = RasterSettings(), *, held: float = 0.5
) -> Floats:
    """[H, W] `blended_depths(..., centres=True).surface` alone, in half of the time.

    Raises:
        DeviceError: the tensors are elsewhere.
    """
    found = _projected(gaussians, camera, settings)
    out = np.empty((camera.height, camera.width), np.float32)
    least, level = np.float32(found.view[V_ALPHA_MINIMUM]), np.float32(1.0 - held)
    arguments = (found.splats, found.tile_starts, found.pairs, least, level, found.tiles_x, out)
    run(find_surface, len(found.tile_starts) - 1, *arguments, grain=4)
    out[out <= 0] = np.nan
    return out


def _projected(gaussians: Gaussians, camera: Camera, settings: RasterSettings) -> Projected:
    if gaussians.means.device.type != "cpu" or gaussians.means.dtype != torch.float32:
        raise DeviceError("Depths are blended from float32 tensors on the CPU", "Move the Gaussians there")
    parts = (
        gaussians.means,
        gaussians.log_scales,
        gaussians.quaternions,
        gaussians.opacity_logits,
        gaussians.sh[:, :1],
    )
    view, radius = view_vector(camera, None, settings), np.empty(len(gaussians), np.float32)
    return project_and_sort(view, numpy_parameters(*parts), camera.width, camera.height, radius)


def _rays(gaussians: Gaussians, camera: Camera) -> Floats:
    """[N, 16] rows of `blend_depths`: depth(d) = (K d) . (K m) / |K d|^2 is where a Gaussian is densest along d.

    K = S^-1 Rq^T R^T, all divided by |K m|; m is the centre in the camera's axes, d = (x / z, y / z, 1).
    """
    pose = np.concatenate([camera.rotation.ravel(), camera.translation])
    shapes = (gaussians.means, gaussians.log_scales, gaussians.quaternions)
    arrays = [np.ascontiguousarray(tensor.detach().numpy()) for tensor in shapes]
    rays = np.empty((len(gaussians), RAY_WIDTH), np.float32)
    run(place_rays, len(rays), *arrays, pose, _THINNEST, _REACH, rays, grain=4096)
    return rays


def _at_centres(gaussians: Gaussians, camera: Camera) -> Floats:
    """The same for depths of centres: the limits leave no choice."""
    rays = np.zeros((len(gaussians), RAY_WIDTH))
    rays[:, 8] = 1.0
    rays[:, K_M + 2] = rays[:, LOW] = rays[:, HIGH] = _points(gaussians, camera)[:, 2]
    return np.nan_to_num(rays).astype(np.float32)


def _points(gaussians: Gaussians, camera: Camera) -> NDArray[np.float64]:
    means = gaussians.means.detach().double().numpy()
    return np.asarray(means @ camera.rotation.T + camera.translation)
