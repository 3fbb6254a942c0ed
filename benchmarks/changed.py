"""What photos hold of a change: how each place of a surface has moved between two twins of one world, with an interval.

    python -m benchmarks.changed BEFORE AFTER           # twins of photos of `cracked_wall` with given cameras
    python -m benchmarks.changed BEFORE AGAIN --false   # the same scene again: all that is found is false

Both sets of photos are compared with the first twin through each photo's own blur. Where a place of its surface moves
by d, a photo of it changes by -g' P d, with the gradients g of the degraded render and the projection P; over a window
and all photos, by least squares,

    d = (sum P' g g' P)^-1 sum P' g r,     r: render minus photo

and its covariance is how much the photos disagree about it (a sandwich, one term for each photo). What the first set
says of itself is what the twin has wrong, and is taken off. Light is separated by a gain and an offset for each photo
and channel, whole and in slow fields.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.forward import ForwardModel, low_pass_on_grid, shared_medium, sharp_depths, space_of
from dgs.core.frames import Frame
from dgs.core.mesh.build import MeshSettings, build_mesh
from dgs.core.mesh.surfaces import SURFACE
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.grid import GridView
from dgs.core.twin.opened import OpenedTwin, open_twin
from scipy.ndimage import gaussian_filter, uniform_filter
from scipy.stats import chi2

#: Px: side of a window; standard deviation of the slow fields of light; within which a surface is the same.
WINDOW, SLOW, SAME = 11, 25.0, 5.0
#: Px-equivalents: what is left of every motion; below which no motion is called one.
FLOOR, SMALLEST_MOTION = 0.05, 0.3
#: Of a place that has not changed to be called changed, if all were as modelled.
LEVEL = 1e-4


@dataclass(frozen=True)
class Motion:
    """Of each place: [N, 3] px-equivalents, [N, 3, 3] covariance, [N] photos that see it."""

    by: np.ndarray
    covariance: np.ndarray
    seen: np.ndarray


def lit_alike(shown: np.ndarray, photo: np.ndarray) -> np.ndarray:
    """[3, H, W] photo minus render, in the render's light."""
    difference = np.empty_like(shown)
    for channel, (a, b) in enumerate(zip(shown, photo, strict=True)):
        weight = np.ones_like(a)
        for _ in range(10):
            rows = np.stack([a.ravel(), np.ones(a.size)], axis=1) * weight.ravel()[:, None]
            gain, offset = np.linalg.lstsq(rows, (b * weight).ravel(), rcond=None)[0]
            rest = b - gain * a - offset
            weight = (1 + (rest / (2 * (1.4826 * np.median(abs(rest)) + 1e-4))) ** 2) ** -0.5
        difference[channel] = (b - offset) / gain - a
    size = np.sqrt((difference**2).mean(axis=0))
    weight = 1 / (1 + (size / (2 * (1.4826 * np.median(size) + 1e-4))) ** 2)
    slow = gaussian_filter(weight, SLOW)
    for a, d in zip(shown, difference, strict=True):
        mean_a, mean_d = (gaussian_filter(weight * part, SLOW) / slow for part in (a, d))
        both = gaussian_filter(weight * a * d, SLOW) / slow - mean_a * mean_d
        own = gaussian_filter(weight * a * a, SLOW) / slow - mean_a**2 + 1e-3
        d -= mean_d + both / own * (a - mean_a)
    return difference


def motion(first: OpenedTwin, other: OpenedTwin, places: np.ndarray, pixel: np.ndarray) -> Motion:
    """What `other`'s photos say of `first`'s surface at `places` [N, 3], whose px are `pixel` [N] wide."""
    drawn, gaussians = RasterSettings(low_pass=low_pass_on_grid(1)), first.scale.to_unit(first.gaussians)
    margin, space = other.margin(1), space_of(other.medium)
    model = ForwardModel(
        drawn, lambda v: shared_medium(v.psf, Frame(v.camera.height, v.camera.width, margin), space), margin
    )
    unit, count = first.scale.points_to_unit(places), len(places)
    matrices, moments = [], []
    for view in other.kept:
        psf, camera = other.medium.psf_for(view.name), first.scale.camera_to_unit(view.camera)
        seen_by = GridView(view, camera, 1, psf, other.medium.blur_space)
        depths = sharp_depths(gaussians, camera, drawn, held=SURFACE.held)
        with torch.no_grad():
            shown = model.medium(seen_by).degraded(model.sharp(gaussians, camera, other.background).image).numpy()
        matrix, moment = np.zeros((count, 3, 3), np.float32), np.zeros((count, 3), np.float32)
        index, at, projection = projected(
            unit, camera, np.where(depths.alpha >= SURFACE.opacity, depths.surface, np.nan)
        )
        products, sides = equations(shown, lit_alike(shown, seen_by.planes()))
        projection = projection * (pixel[index] / first.scale.size)[:, None, None]  # px for each px-equivalent
        matrix[index] = np.einsum("nki,kln,nlj->nij", projection, products[:, :, at[1], at[0]], projection)
        moment[index] = np.einsum("nki,kn->ni", projection, sides[:, at[1], at[0]])
        matrices.append(matrix)
        moments.append(moment)
    whole, sides = np.sum(matrices, axis=0, dtype=np.float64), np.sum(moments, axis=0, dtype=np.float64)
    seen = np.sum([np.trace(m, axis1=1, axis2=2) > 0 for m in matrices], axis=0)
    inverse = np.linalg.inv(whole + (1e-6 * np.trace(whole, axis1=1, axis2=2) + 1e-9)[:, None, None] * np.eye(3))
    by = np.einsum("nij,nj->ni", inverse, sides)
    scatter = np.zeros_like(whole)
    for matrix, moment in zip(matrices, moments, strict=True):
        rest = moment - np.einsum("nij,nj->ni", matrix, by)
        scatter += rest[:, :, None] * rest[:, None, :]
    freedom = (seen / np.maximum(seen - 3, 1))[:, None, None]
    return Motion(by, freedom * inverse @ scatter @ inverse, seen)


def projected(places: np.ndarray, camera: Camera, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which places a camera sees, [2, M] their px, and [M, 2, 3] how these move with the places."""
    local = places @ camera.rotation.T + camera.translation
    x, y, z = local.T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    border = 2 * WINDOW
    inside = (z > 0) & (abs(u - camera.width / 2) < camera.width / 2 - border)
    index = np.flatnonzero(inside & (abs(v - camera.height / 2) < camera.height / 2 - border))
    at = np.stack([u[index], v[index]]).astype(int)
    same = abs(depth[at[1], at[0]] - z[index]) < SAME * z[index] / camera.fx
    index, at = index[same], at[:, same]
    x, y, z = local[index].T
    jacobian = np.zeros((len(index), 2, 3))
    jacobian[:, 0, 0], jacobian[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
    jacobian[:, 1, 1], jacobian[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
    return index, at, jacobian @ camera.rotation


def equations(shown: np.ndarray, difference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[2, 2, H, W] sums of g g' over windows, and [2, H, W] of -g times photo minus render."""
    gy, gx = np.gradient(shown + 0.5 * difference, axis=(1, 2))
    xx, xy, yy, x, y = (
        uniform_filter(part.sum(axis=0), WINDOW) * WINDOW**2
        for part in (gx * gx, gx * gy, gy * gy, -gx * difference, -gy * difference)
    )
    return np.array([[xx, xy], [xy, yy]]), np.array([x, y])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--false", action="store_true", help="nothing has changed: say what is found all the same")
    options = parser.parse_args()
    first, after = open_twin(options.before, Silent()), open_twin(options.after, Silent())
    cameras = [view.camera for view in first.kept]
    mesh = build_mesh(first.gaussians, cameras, MeshSettings(detail=2.0, faces=6000), Silent()).mesh
    away = [np.linalg.norm(mesh.vertices - camera.centre, axis=1) / camera.fx for camera in cameras]
    pixel = np.median(away, axis=0)
    own, other = (motion(first, twin, mesh.vertices, pixel) for twin in (first, after))
    held = (own.seen >= 6) & (other.seen >= 6)
    by = (other.by - own.by)[held]
    covariance = (own.covariance + other.covariance)[held] + FLOOR**2 * np.eye(3)
    surprise = np.einsum("ni,nij,nj->n", by, np.linalg.inv(covariance), by)
    changed = (surprise > chi2.ppf(1 - LEVEL, 3)) & (np.linalg.norm(by, axis=1) > SMALLEST_MOTION)
    print(f"{held.sum()} of {len(held)} places are held by photos; called changed: {100 * changed.mean():.2f} %")
    print("surprise, median (2.4 if as modelled):", np.round(np.median(surprise), 2))
    print("95 % regions that hold none:", np.round(100 * (surprise < chi2.ppf(0.95, 3)).mean(), 1), "%")
    if options.false:
        return
    x, up, out = mesh.vertices[held][:, 0], -mesh.vertices[held][:, 1], -mesh.vertices[held][:, 2]
    parts = {
        "block's front": (abs(x - 0.36) < 0.08) & (abs(up - 0.18) < 0.08) & (out > 0.04),
        "knob": (x - 0.38) ** 2 + (up + 0.22) ** 2 < 0.07**2,
        "middle crack": abs(x + 0.19) < 0.04,
        "wall, farther than 0.1 m from all": (x < 0.02) & (abs(x + 0.19) > 0.14),
    }
    for name, part in parts.items():
        outward, sure = -by[part][:, 2], np.sqrt(covariance[part][:, 2, 2])
        words = f"outwards {np.median(outward):+.2f} px (median), its deviation {np.median(sure):.2f}"
        print(f"{name}: {part.sum()} places, called changed {100 * changed[part].mean():.0f} %; {words}")


if __name__ == "__main__":
    main()
