"""What each camera sees of a twin's surface: depth, and how much one may rely on it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..compiled import threads
from ..errors import Cancelled
from ..forward import sharp_depths, sharp_view
from ..gaussians import Gaussians
from ..numbers import number
from ..progress import Progress
from ..rasterizer import RasterSettings

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class SurfaceSettings:
    """What counts as a surface."""

    opacity: float = number(0.5, "share", "of light that a px must hold back to have a surface: half")
    held: float = number(
        0.4,
        "share",
        "of light that is held back in front of the surface: the median (0.5) lies behind it on most twins, the mean"
        " far behind; 0.3 to 0.5 differ little",
        "rendered ball and shelf, sharp: single depth maps 0.76 and 1.08 px, with 0.5 0.86 and 1.04, with 0.2"
        " 0.74 and 1.50",
        "orrery: 1.04 px, with 0.5 1.14",
    )


SURFACE = SurfaceSettings()


@dataclass(frozen=True)
class SeenSurface:
    """One camera's view of the surface.

    Attributes:
        camera: of the view.
        depth: [H, W] along the axis, world units; NaN where there is no surface.
        weight: [H, W] how much a px counts, see `weights`; 0 without a surface.
        image: [3, H, W] float32 sRGB colours of the twin.
    """

    camera: Camera
    depth: Floats = field(repr=False)
    weight: Floats = field(repr=False)
    image: Floats = field(repr=False)

    @property
    def pixel(self) -> Floats:
        """[H, W] size of a px on the surface, world units; NaN where there is none."""
        return self.depth / np.float32(self.camera.fx)


def seen_surfaces(
    gaussians: Gaussians, cameras: Sequence[Camera], progress: Progress, settings: SurfaceSettings = SURFACE
) -> list[SeenSurface]:
    """What every camera sees.

    Args:
        gaussians: on the CPU, in the cameras' world.

    Raises:
        Cancelled: the user asked to stop.
    """
    progress.stage("depth", len(cameras))
    found: list[SeenSurface] = []
    pool = ThreadPoolExecutor(min(2, threads()))  # (half of each view's work runs on one core; more take memory)
    try:
        for surface in pool.map(lambda camera: seen_surface(gaussians, camera, settings), cameras):
            if progress.cancelled():
                raise Cancelled(f"Stopped after {len(found)} of {len(cameras)} depth maps; nothing was written")
            found.append(surface)
            progress.advance(len(found))
    finally:
        pool.shutdown(cancel_futures=True)
    return found


def seen_surface(gaussians: Gaussians, camera: Camera, settings: SurfaceSettings = SURFACE) -> SeenSurface:
    """What one camera sees."""
    drawn = RasterSettings()
    depths = sharp_depths(gaussians, camera, drawn, held=settings.held)
    depth = np.where(depths.alpha >= settings.opacity, depths.surface, np.nan).astype(np.float32)
    image = sharp_view(gaussians.detached(), camera, drawn).image.numpy()
    return SeenSurface(camera, depth, weights(depth, camera), image)


def weights(depth: Floats, camera: Camera) -> Floats:
    """[H, W] weight of a px's depth: what is seen from aside is less certain, and so is a step in the depth."""
    with np.errstate(invalid="ignore"):
        pixel = depth / camera.fx
        slope = [np.abs(np.diff(depth, axis=axis)) for axis in (0, 1)]
        steep = np.zeros_like(depth)
        for axis, step in enumerate(slope):
            before, after = [slice(None)] * 2, [slice(None)] * 2
            before[axis], after[axis] = slice(None, -1), slice(1, None)
            # the gentler of both sides: only a px between two steps is nobody's surface
            sides = np.full((2, *depth.shape), np.inf, np.float32)
            sides[0][tuple(before)] = step
            sides[1][tuple(after)] = step
            gentler = np.fmin(sides[0], sides[1])
            steep += (np.where(np.isfinite(gentler), gentler, 1e3 * pixel) / pixel) ** 2
        weight = 1.0 / (1.0 + steep) / pixel**2
    return np.nan_to_num(weight, nan=0.0, posinf=0.0).astype(np.float32)
