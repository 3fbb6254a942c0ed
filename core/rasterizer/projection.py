"""From Gaussians in the world to ellipses in the frame: culling and EWA projection, in plain torch.

    p = R mean + t                                  camera coordinates
    mean2D = (fx x / z + cx, fy y / z + cy)
    M = J R Rq S                                    [2, 3], covariance2D = M M^T + low_pass I

(Zwicker et al. 2001; Kerbl et al. 2023, section 4.) Culling is decided first, outside the autograd
graph; only survivors are projected inside it, so no NaN of a culled Gaussian can reach a gradient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..constants import (
    DETERMINANT_MINIMUM,
    FAR_PLANE,
    FRUSTUM_MARGIN,
    HARMONICS_LIMIT,
    LOG_SCALE_LIMIT,
    QUATERNION_MINIMUM_NORM,
)
from ..gaussians import Gaussians
from ..rendering import RasterSettings
from .harmonics import colours

#: Stands in for `alpha_minimum` = 0 where an ellipse needs an edge.
SMOOTH_ALPHA_EDGE = 1.0e-12


@dataclass
class Projected:
    """Gaussians as the blending sees them, all in px or camera units.

    Attributes:
        mean: [M, 2] projected centre.
        conic: [M, 3] entries xx, xy, yy of the inverse covariance (1/px^2).
        opacity: [M] in (0, 1), with the antialiasing compensation.
        colour: [M, 3].
        depth: [M] z in camera coordinates.
        determinant: [M] of the covariance, divided by the square of `unit` (px^2).
        unit: [M] length (px) in which the covariance was computed; the splat's size, at least 1.
        extent: [M, 2] half sides of the box around the ellipse of influence.
    """

    mean: Tensor
    conic: Tensor
    opacity: Tensor
    colour: Tensor
    depth: Tensor
    determinant: Tensor
    unit: Tensor
    extent: Tensor


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Rotation matrices [N, 3, 3] of quaternions [N, 4] (w x y z, any length but zero)."""
    w, x, y, z = unit_vectors(quaternions).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(rows, dim=-1).reshape(-1, 3, 3)


def camera_pose(camera: Camera, like: Tensor) -> Tensor:
    """The camera's own pose, [3, 4] world to camera, with the dtype and device of `like`."""
    pose = np.concatenate([camera.rotation, camera.translation[:, None]], axis=1)
    return torch.as_tensor(pose, dtype=like.dtype, device=like.device)


def camera_points(means: Tensor, pose: Tensor) -> Tensor:
    """World points [N, 3] in camera coordinates, [N, 3].

    Spelled out, because a matrix product may round each row in its own way: equal points must get
    equal depths, or ties would be broken by their place in the input.
    """
    x, y, z = means[:, :1], means[:, 1:2], means[:, 2:]
    return x * pose[:, 0] + y * pose[:, 1] + z * pose[:, 2] + pose[:, 3]


def unit_vectors(vectors: Tensor) -> Tensor:
    """Vectors [N, D] divided by their length, also where its square leaves the range of floats."""
    largest = vectors.detach().abs().amax(dim=-1, keepdim=True)
    vectors = vectors / largest
    return vectors / vectors.norm(dim=-1, keepdim=True)


def jacobian(points: Tensor, camera: Camera) -> Tensor:
    """Jacobian [N, 2, 3] of the perspective projection at camera points [N, 3], in px per unit.

    The direction at which it is taken is clamped to the frame and `FRUSTUM_MARGIN` of its size.
    """
    x, y, z = points.unbind(-1)
    mx, my = FRUSTUM_MARGIN * camera.width, FRUSTUM_MARGIN * camera.height
    tx = (x / z).clamp(-(camera.cx + mx) / camera.fx, (camera.width - camera.cx + mx) / camera.fx)
    ty = (y / z).clamp(-(camera.cy + my) / camera.fy, (camera.height - camera.cy + my) / camera.fy)
    zero = torch.zeros_like(z)
    rows = [camera.fx / z, zero, -camera.fx * tx / z, zero, camera.fy / z, -camera.fy * ty / z]
    return torch.stack(rows, dim=-1).reshape(-1, 2, 3)


def project(gaussians: Gaussians, camera: Camera, pose: Tensor, settings: RasterSettings) -> Projected:
    """Projects all given Gaussians, without any culling.

    Args:
        gaussians: N Gaussians in front of the camera, with finite parameters.
        camera: frame and lens.
        pose: [3, 4] world to camera.
        settings: low-pass, antialiasing and `alpha_minimum` are read.

    Returns:
        N ellipses in the same order.
    """
    points = camera_points(gaussians.means, pose)
    depth = points[:, 2]
    focal = points.new_tensor([camera.fx, camera.fy])
    mean = focal * points[:, :2] / depth[:, None] + points.new_tensor([camera.cx, camera.cy])

    scales = gaussians.log_scales.clamp(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT).exp()
    axes = rotation_matrices(gaussians.quaternions) * scales[:, None, :]
    footprint = jacobian(points, camera) @ (pose[:, :3] @ axes)  # [N, 2, 3]

    # In units of its own size no covariance overflows, however large the splat. The result does
    # not depend on the unit, so it needs no gradient.
    unit = footprint.detach().abs().amax(dim=(1, 2)).clamp(min=1.0)
    (ux, uy), low_pass = (footprint / unit[:, None, None]).unbind(1), settings.low_pass / unit / unit
    xx, xy, yy = (ux * ux).sum(-1), (ux * uy).sum(-1), (uy * uy).sum(-1)
    # Cauchy-Binet: a sum of squares, where xx * yy - xy^2 would cancel for needles.
    bare = (torch.linalg.cross(ux, uy) * unit[:, None]).square().sum(-1)
    determinant = bare + settings.low_pass * (xx + yy) + settings.low_pass * low_pass
    xx, yy = xx + low_pass, yy + low_pass
    conic = torch.stack([yy, -xy, xx], dim=-1) / determinant[:, None]

    # (as exp(log sigmoid), whose derivative keeps its digits where sigmoid is 1 to rounding)
    opacity = torch.nn.functional.logsigmoid(gaussians.opacity_logits).exp()
    if settings.antialias:
        share = bare / determinant
        # The square root has no derivative at 0 (a needle seen end on, to rounding).
        opacity = opacity * torch.where(share > 0, share, torch.ones_like(share)).sqrt() * (share > 0)

    centre = -pose[:, :3].T @ pose[:, 3]
    directions = unit_vectors(gaussians.means - centre)

    with torch.no_grad():
        edge = settings.alpha_minimum or SMOOTH_ALPHA_EDGE
        reach = (2 * (opacity / edge).log()).clamp(min=0.0).sqrt() * unit
        extent = reach[:, None] * torch.stack([xx, yy], dim=-1).sqrt()
    return Projected(mean, conic, opacity, colours(gaussians.sh, directions), depth, determinant, unit, extent)


def select(gaussians: Gaussians, index: Tensor) -> Gaussians:
    """The Gaussians at `index` [M]; gradients flow back to their places."""
    return Gaussians(**{name: tensor[index] for name, tensor in gaussians.named()})


def bare_footprints(gaussians: Gaussians, camera: Camera, settings: RasterSettings) -> Tensor:
    """How many px each Gaussian would cover with nothing before it: its opacity times its ellipse's area.

    Args:
        gaussians: [N], with finite parameters. settings: low-pass and near plane are read.

    Returns:
        [N], px, without gradient; at most the frame's. 0 where the centre lies outside of the frame.
    """
    pose = camera_pose(camera, gaussians.means)
    with torch.no_grad():
        points = camera_points(gaussians.means, pose)
        x, y, depth = points.unbind(-1)
        u, v = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
        framed = (depth > settings.near) & (u > 0) & (u < camera.width) & (v > 0) & (v < camera.height)
        rows = torch.nonzero(framed)[:, 0]
        ellipses = project(select(gaussians, rows), camera, pose, settings)
        area = 2.0 * np.pi * ellipses.opacity * ellipses.determinant.sqrt() * ellipses.unit
        found = torch.zeros_like(depth)
        found[rows] = area.clamp(max=float(camera.width * camera.height))
    return found


@torch.no_grad()
def visible(
    gaussians: Gaussians, camera: Camera, pose: Tensor, settings: RasterSettings
) -> tuple[Tensor, dict[str, int]]:
    """Which Gaussians can change a pixel.

    Returns:
        index: [M] int64, ascending.
        culled: number of the others by the first reason that applied.
    """
    culled: dict[str, int] = {}
    index = torch.arange(len(gaussians), device=gaussians.means.device)

    def keep(mask: Tensor, reason: str) -> None:
        nonlocal index
        culled[reason] = culled.get(reason, 0) + int(index.numel() - mask.sum())
        index = index[mask]

    finite = [tensor[:, None].flatten(1).isfinite().all(dim=1) for _, tensor in gaussians.named()]
    keep(torch.stack(finite).all(dim=0), "non_finite")
    keep(camera_points(gaussians.means[index], pose)[:, 2] > settings.near, "behind")
    keep(gaussians.quaternions[index].norm(dim=-1) >= QUATERNION_MINIMUM_NORM, "degenerate")
    candidates = project(select(gaussians, index), camera, pose, settings)

    results = [candidates.mean, candidates.conic, candidates.extent, candidates.colour, candidates.determinant[:, None]]
    sound = torch.cat(results, dim=1).isfinite().all(dim=1)
    sound &= candidates.determinant * candidates.unit**2 >= DETERMINANT_MINIMUM
    sound &= candidates.depth < FAR_PLANE
    sound &= gaussians.sh[index].square().sum(dim=(1, 2)) <= HARMONICS_LIMIT**2
    opaque = candidates.opacity > (settings.alpha_minimum or SMOOTH_ALPHA_EDGE)
    frame = candidates.mean.new_tensor([camera.width, camera.height])
    beside = (candidates.mean + candidates.extent <= 0) | (candidates.mean - candidates.extent >= frame)

    keep(sound, "degenerate")
    keep(opaque[sound], "transparent")
    keep(~beside.any(dim=1)[sound][opaque[sound]], "outside")
    return index, culled
