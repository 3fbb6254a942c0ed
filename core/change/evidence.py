"""What photos say of how each place of a surface has moved.

Photos are compared with the first twin through each photo's own blur. Where a place of its surface moves by d, a photo
of it changes by -g' P d, with the gradients g of the degraded render and the projection P; over a window and all
photos, by least squares,

    d = (sum P' g g' P)^-1 sum P' g r,     r: render minus photo

and its covariance is how much the photos disagree about it (a sandwich, one term for each photo).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from ..camera import Camera
from ..errors import Cancelled
from ..forward import ForwardModel, low_pass_on_grid, shared_medium, sharp_depths, space_of
from ..frames import Frame
from ..mesh.surfaces import SURFACE
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..training.grid import GridView
from ..twin.opened import OpenedTwin
from ..views import View
from .light import SlowLight, lit_alike
from .settings import EVIDENCE

Floats = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """Corners of a mesh.

    Attributes:
        at: [N, 3] world of the first twin; pixel: [N] size of a px there, world units.
    """

    at: Array = field(repr=False)
    pixel: Array = field(repr=False)


@dataclass(frozen=True)
class Evidence:
    """One set of photos about N places, photo by photo, in px-equivalents; zeros where a photo does not see one.

    Attributes:
        matrices: [P, N, 3, 3] sums of P' g g' P over the window; moments: [P, N, 3] of P' g r.
        energies: [P, N] mean square residual in the window, sRGB^2.
        gains: [P] of the light, photo over render.
    """

    matrices: Floats = field(repr=False)
    moments: Floats = field(repr=False)
    energies: Floats = field(repr=False)
    gains: Floats = field(repr=False)

    @property
    def sees(self) -> NDArray[np.bool_]:
        """[P, N] which photo sees which place."""
        return np.asarray(np.trace(self.matrices, axis1=2, axis2=3) > 0)

    @property
    def seen(self) -> NDArray[np.int64]:
        """[N] photos that see a place."""
        return np.asarray(self.sees.sum(axis=0))

    def rows(self, order: NDArray[np.int64]) -> Evidence:
        """Its photos in another order; zeros for -1."""
        none = order < 0
        parts = [part[np.where(none, 0, order)] for part in (self.matrices, self.moments, self.energies, self.gains)]
        for part in parts:
            part[none] = 0
        return Evidence(*parts)

    def moved(self, by: Array) -> Evidence:
        """About places that had stood `by` [N, 3] px-equivalents off: that motion is taken out."""
        part = np.einsum("pnij,nj->pni", self.matrices, by.astype(np.float32))
        return replace(self, moments=self.moments - part)


def evidence(
    surface: OpenedTwin,
    photos: OpenedTwin,
    places: Places,
    progress: Progress,
    to_world: Callable[[Camera], Camera] | None = None,
) -> Evidence:
    """What the photos of one twin say of another's surface.

    Args:
        surface: whose surface it is; photos: whose photos are asked.
        to_world: brings a camera of `photos` into the world of `surface`.

    Raises:
        Cancelled: the user asked to stop.
    """
    views = photos.kept
    step = step_of(photos)
    about = About(surface, photos, places, step)
    progress.stage("compare", len(views))
    found = []
    for index, view in enumerate(views):
        if progress.cancelled():
            raise Cancelled("Stopped while photos were compared; nothing was written")
        found.append(about.seen_in(view, view.camera if to_world is None else to_world(view.camera)))
        progress.advance(index + 1)
    return Evidence(*(np.stack(part).astype(np.float32) for part in zip(*found, strict=True)))


def step_of(photos: OpenedTwin) -> int:
    """Photo px per px that are compared: what the blur allows, where photos are large."""
    return max(1, min(photos.step, photos.views[0].camera.width // EVIDENCE.finest))


@dataclass(frozen=True)
class Shown:
    """What a photo would show of a surface that has not changed.

    Attributes:
        grid: the photo, on the grid that is compared; its camera stands in the surface's unit.
        sharp: [3, H + 2m, W + 2m] without its blur; degraded: what its blur makes of such an image, [3, H, W].
        image: [3, H, W] `sharp`, degraded; depth: [H, W] of the surface, NaN where there is none.
    """

    grid: GridView
    sharp: torch.Tensor = field(repr=False)
    degraded: Callable[[torch.Tensor], torch.Tensor] = field(repr=False)
    image: Floats = field(repr=False)
    depth: Floats = field(repr=False)


class About:
    """Compares photos with a surface one by one."""

    def __init__(self, surface: OpenedTwin, photos: OpenedTwin, places: Places, step: int) -> None:
        self.surface, self.photos, self.places, self.step = surface, photos, places, step
        self.drawn = RasterSettings(low_pass=low_pass_on_grid(step))
        self.gaussians = surface.scale.to_unit(surface.gaussians)
        self.unit = surface.scale.points_to_unit(places.at)
        margin, space = photos.margin(step), space_of(photos.medium)
        self.model = ForwardModel(
            self.drawn, lambda v: shared_medium(v.psf, Frame(v.camera.height, v.camera.width, margin), space), margin
        )

    def shown(self, view: View, camera: Camera) -> Shown:
        """What a photo would show, whose camera stands in this world."""
        medium = self.photos.medium
        at = self.surface.scale.camera_to_unit(camera)
        grid = GridView(view, at, self.step, medium.psf_for(view.name), medium.blur_space)
        with torch.no_grad():
            sharp = self.model.sharp(self.gaussians, grid.camera, self.photos.background).image
            degraded = self.model.medium(grid).degraded
            return Shown(grid, sharp, degraded, degraded(sharp).numpy(), self.depth(grid.camera))

    def depth(self, camera: Camera) -> Floats:
        """[H, W] of the surface before a camera in its unit; NaN where there is none."""
        depths = sharp_depths(self.gaussians, camera, self.drawn, held=SURFACE.held)
        return np.where(depths.alpha >= SURFACE.opacity, depths.surface, np.nan)

    def seen_in(self, view: View, camera: Camera) -> tuple[Floats, Floats, Floats, float]:
        """Matrices [N, 3, 3], moments [N, 3], energies [N] and gain of a photo, whose camera stands in this world."""
        shown = self.shown(view, camera)
        difference, light = lit_alike(shown.image, shown.grid.planes())
        return *self.said(shown, difference, light), light.gain

    def said(self, shown: Shown, difference: Floats, light: SlowLight) -> tuple[Floats, Floats, Floats]:
        """Matrices [N, 3, 3], moments [N, 3] and energies [N] of a difference [3, H, W] from what would be shown."""
        count = len(self.unit)
        matrix, moment = np.zeros((count, 3, 3), np.float32), np.zeros((count, 3), np.float32)
        energy = np.zeros(count, np.float32)
        index, at, projection = projected(self.unit, shown.grid.camera, shown.depth)
        products, sides, squares = equations(shown.image, difference, light)
        # Px of the grid for each px-equivalent.
        projection = projection * (self.places.pixel[index] / self.surface.scale.size)[:, None, None]
        matrix[index] = np.einsum("nki,kln,nlj->nij", projection, products[:, :, at[1], at[0]], projection)
        moment[index] = np.einsum("nki,kn->ni", projection, sides[:, at[1], at[0]])
        energy[index] = squares[at[1], at[0]]
        return matrix, moment, energy


def projected(places: Array, camera: Camera, depth: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Which places a camera sees, [2, M] their px, and [M, 2, 3] how these move with the places."""
    local = places @ camera.rotation.T + camera.translation
    px, z = camera.projected(places)
    u, v = px.T  # (NaN behind the camera, and so not inside)
    border = min(2 * EVIDENCE.window, camera.width // 8, camera.height // 8)
    inside = abs(u - camera.width / 2) < camera.width / 2 - border
    index = np.flatnonzero(inside & (abs(v - camera.height / 2) < camera.height / 2 - border))
    at = np.stack([u[index], v[index]]).astype(int)
    same = abs(depth[at[1], at[0]] - z[index]) < EVIDENCE.same * z[index] / camera.fx
    index, at = index[same], at[:, same]
    return index, at, jacobian(local[index], camera)


def jacobian(local: Array, camera: Camera) -> Array:
    """[M, 2, 3] how px move with places of the world, [M, 3] in the camera's own axes."""
    x, y, z = local.T
    found = np.zeros((len(local), 2, 3))
    found[:, 0, 0], found[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
    found[:, 1, 1], found[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
    return found @ camera.rotation


def equations(shown: Floats, difference: Floats, light: SlowLight) -> tuple[Floats, Floats, Floats]:
    """[2, 2, H, W] sums of g g' over windows, [2, H, W] of -g times photo minus render, [H, W] its mean square.

    What fields of light could explain was taken out of the difference, and is out of the gradients: of motion, too,
    they explain a part, which would be missing in it.
    """
    gy, gx = (light.without(part) for part in np.gradient(shown + 0.5 * difference, axis=(1, 2)))
    window = EVIDENCE.window
    xx, xy, yy, x, y = (
        uniform_filter(part.sum(axis=0), window) * window**2
        for part in (gx * gx, gx * gy, gy * gy, -gx * difference, -gy * difference)
    )
    squares = uniform_filter((difference**2).mean(axis=0), window)
    return np.array([[xx, xy], [xy, yy]]), np.array([x, y]), squares
