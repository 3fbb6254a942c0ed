"""First Gaussians: surfaces guessed between the sparse points, as dense as the budget allows.

Structure from motion gives a few thousand points, unevenly. In every photo the depth between the
points it sees is interpolated (Delaunay triangles in the image), pixels are drawn evenly over the
frame and lifted to that depth with the photo's colour. The optimizer moves what is wrong; what it
would otherwise spend half its time on, growing, is done before it starts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import QhullError, cKDTree

from ...camera import Camera
from ...constants import SH_C0, SH_COEFFICIENTS
from ...gaussians import Gaussians
from ...numbers import BY_DEFINITION, number
from ...views import SparsePoints

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InitialSettings:
    """Numbers of the first Gaussians."""

    opacity: float = number(0.5, "opacity", "of each; 3DGS starts at 0.1, but these lie on surfaces already")
    faint: float = number(
        0.05, "opacity", "of one on a sample of no confidence: it must be asked for by photos before it hides others"
    )
    budget_share: float = number(
        0.8, "share of the budget", "that lifted px fill; the rest is left for the density control"
    )
    lifted_views: int = number(
        16, "photos", "whose depth is interpolated, evenly chosen: more only repeat the same surface"
    )
    minimum_points: int = number(8, "count", "sparse points that an interpolation of a photo's depth needs")
    least_shown: float = number(
        0.05, "share", "of a photo that is taken to show something: px are drawn more densely, the less of it does"
    )
    neighbours: int = number(
        3, "count", "whose mean squared distance is a Gaussian's spacing", "3D Gaussian splatting (Kerbl et al. 2023)"
    )
    size: float = number(0.5, "spacing", "standard deviation of a first Gaussian")
    lone_spacing: float = number(0.01, "viewing distance", "spacing of a Gaussian that is the only one")
    minimum_variance: float = number(
        1e-14, "viewing distance^2", "of points at one place, whose logarithm would not be finite", BY_DEFINITION
    )


INITIAL = InitialSettings()


def _seen(camera: Camera, positions: Array) -> tuple[Array, Array]:
    """Pixels [K, 2] and depths [K] of the points inside the frame."""
    p = positions @ camera.rotation.T + camera.translation
    p = p[p[:, 2] > 0]
    uv = p[:, :2] / p[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    inside = ((uv >= 0) & (uv < (camera.width, camera.height))).all(axis=1)
    return uv[inside], p[inside, 2]


def lifted_points(
    camera: Camera, positions: Array, count: int, margin: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """Draws `count` pixels evenly over the frame and lifts them to the interpolated depth.

    Args:
        positions: [M, 3] sparse points in the camera's world.
        margin: px beyond the frame that are covered too.

    Returns:
        positions [K, 3] and pixels [K, 2] (x, y); empty if the view sees too few points.
    """
    uv, depth = _seen(camera, positions)
    if len(uv) < INITIAL.minimum_points:
        return np.zeros((0, 3)), np.zeros((0, 2))
    # blue-ish noise: one pixel at a random place of each cell of a grid
    area = (camera.width + 2 * margin) * (camera.height + 2 * margin)
    cell = float(np.sqrt(area / max(count, 1)))
    nx, ny = max(1, round((camera.width + 2 * margin) / cell)), max(1, round((camera.height + 2 * margin) / cell))
    gx, gy = np.meshgrid(np.arange(nx), np.arange(ny))
    pixels = np.stack([gx.ravel(), gy.ravel()], axis=1) + random.random((nx * ny, 2))
    pixels *= ((camera.width + 2 * margin) / nx, (camera.height + 2 * margin) / ny)
    pixels -= margin
    z = depth_between(uv, depth, pixels)
    x = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy) * z[:, None]
    in_camera = np.concatenate([x, z[:, None]], axis=1)
    return (in_camera - camera.translation) @ camera.rotation, pixels


def depth_between(uv: Array, depth: Array, pixels: Array) -> Array:
    """[K] depths of px [K, 2] between points of known depth [N] at [N, 2]; outside of all triangles the nearest's."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator  # late: a fifth of a second

    inverse = 1.0 / depth  # inverse depth is linear in the image on a plane
    try:
        between = LinearNDInterpolator(uv, inverse)(pixels)
    except QhullError:  # all points on one line of the image
        between = np.full(len(pixels), np.nan)
    outside = ~np.isfinite(between)
    if outside.any():
        between[outside] = NearestNDInterpolator(uv, inverse)(pixels[outside])
    return np.asarray(1.0 / between)


def first_gaussians(
    cameras: Sequence[Camera],
    planes: Callable[[int], NDArray[np.float32]],
    points: SparsePoints,
    count: int,
    sh_degree: int,
    random: np.random.Generator,
    margin: float = 0.0,
) -> Gaussians:
    """Gaussians on the guessed surfaces, isotropic, half opaque, coloured from the photos.

    Args:
        cameras: the training views in unit coordinates.
        planes: gives view i as [3, H, W] float32 sRGB (sharpened photos serve better); NaN where it shows nothing, so
            that nothing is lifted there.
        points: the sparse points, in unit coordinates; with samples of the surfaces between them nothing is lifted.
        count: the budget; about `INITIAL.budget_share` of it is used.
        margin: px beyond the frames that the twin should cover.
    """
    target = max(1, int(count * INITIAL.budget_share))
    samples = points if points.confidence is not None else points.samples
    if samples is not None:
        return _on_samples(samples, target, sh_degree, random)
    positions, colours = points.positions, points.colours
    chosen = np.unique(np.linspace(0, len(cameras) - 1, min(INITIAL.lifted_views, len(cameras))).astype(int))
    share = max(1, target // len(chosen))
    all_positions, all_colours = [], []
    for index in chosen:
        camera, image = cameras[index], planes(int(index))
        shows = float(np.isfinite(image[0]).mean())
        if shows == 0:
            continue
        lifted, pixels = lifted_points(camera, positions, int(share / max(shows, INITIAL.least_shown)), margin, random)
        if len(lifted) == 0:
            continue
        x = np.clip(pixels[:, 0].astype(int), 0, image.shape[2] - 1)
        y = np.clip(pixels[:, 1].astype(int), 0, image.shape[1] - 1)
        seen = image[:, y, x].T
        shown = np.isfinite(seen[:, 0])
        all_positions.append(lifted[shown])
        all_colours.append(seen[shown])
    if sum(len(p) for p in all_positions) < target // 2 or len(positions) > target:
        keep = random.permutation(len(positions))[:target]
        all_positions.append(positions[keep])
        all_colours.append(colours[keep].astype(np.float32) / 255.0)
    centres = np.concatenate(all_positions)
    rgb = np.clip(np.concatenate(all_colours), 0.0, 1.0)
    if len(centres) > count:  # dense sparse points come on top of the lifted ones
        keep = random.permutation(len(centres))[:count]
        centres, rgb = centres[keep], rgb[keep]
    return gaussians_at(centres, rgb, sh_degree)


def _on_samples(points: SparsePoints, target: int, sh_degree: int, random: np.random.Generator) -> Gaussians:
    """Gaussians on samples of surfaces, at most `target`: the surer a surface, the more opaque."""
    assert points.confidence is not None
    if len(points.positions) > target:
        points = points.chosen(np.sort(random.permutation(len(points.positions))[:target]))
    gaussians = gaussians_at(points.positions, points.colours.astype(np.float32) / 255.0, sh_degree)
    sure = torch.from_numpy(np.asarray(points.confidence, np.float32))
    gaussians.opacity_logits = torch.logit(INITIAL.faint + (INITIAL.opacity - INITIAL.faint) * sure)
    return gaussians


def gaussians_at(centres: Array, rgb: NDArray[np.float32], sh_degree: int) -> Gaussians:
    """Isotropic Gaussians whose size is the distance to the next few neighbours."""
    n = len(centres)
    spacing = np.full(n, INITIAL.lone_spacing)
    if n > 1:
        near = cKDTree(centres).query(centres, k=min(1 + INITIAL.neighbours, n), workers=-1)[0][:, 1:]
        spacing = np.sqrt(np.maximum((near**2).mean(axis=1), INITIAL.minimum_variance))
    sh = np.zeros((n, SH_COEFFICIENTS[sh_degree], 3), np.float32)
    sh[:, 0] = (rgb - 0.5) / SH_C0
    quaternions = np.zeros((n, 4), np.float32)
    quaternions[:, 0] = 1.0
    opacity = np.log(INITIAL.opacity / (1 - INITIAL.opacity))
    return Gaussians(
        means=torch.from_numpy(centres.astype(np.float32)),
        log_scales=torch.from_numpy(np.log(INITIAL.size * spacing)[:, None].repeat(3, axis=1).astype(np.float32)),
        quaternions=torch.from_numpy(quaternions),
        opacity_logits=torch.full((n,), float(opacity)),
        sh=torch.from_numpy(sh),
    )
