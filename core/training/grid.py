"""The photos on the grid that the optimizer works on.

A photo blurred by sigma 5 px holds nothing that a grid of half as many pixels could not: training
there is three times faster for 0.05 dB. Photos are averaged over s x s pixels. A render on that grid is not
averaged, so that the averaging becomes part of its point spread (`PointSpread.on_grid`).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ..background import Colour
from ..camera import Camera
from ..colour import linear_to_srgb, srgb_to_linear
from ..compositing import over_another
from ..imaging.medium import BlurSpace, Medium
from ..imaging.psf import PointSpread
from ..numbers import BY_DEFINITION, number
from ..photos.store import kept_beside
from ..views import View


@dataclass(frozen=True)
class GridSettings:
    """Numbers of the grid that photos are averaged on."""

    sigmas_per_step: float = number(
        2.5,
        "standard deviations of the PSF",
        "per px of the grid: 5 px of blur are trained on a grid of 2 px, three times faster for 0.05 dB; wider blurs on"
        " coarser ones",
        "a blur of 5 px, one set",
    )
    smallest_side: int = number(96, "px", "along the short side of a grid; with fewer there is no coarse stage either")
    valid_share: float = number(
        0.999, "share", "of a grid px that must count in the photo: all of it, but for rounding", BY_DEFINITION
    )


GRID = GridSettings()


def grid_step(medium: Medium, width: int, height: int) -> int:
    """How many photo pixels one grid pixel covers along a side, for the narrowest blur there is."""
    spreads = [medium.psf, *medium.per_view.values()]
    narrowest = min(
        (0.0 if p is None or p.is_identity else float(np.linalg.eigvalsh(p.covariance)[0]) ** 0.5 for p in spreads),
        default=0.0,
    )
    step = max(1, round(narrowest / GRID.sigmas_per_step))
    return min(step, max(1, min(width, height) // GRID.smallest_side))


def coarse_camera(camera: Camera, step: int) -> Camera:
    """The camera of a photo averaged over `step` x `step` px (a rest at the right and bottom is cut)."""
    return replace(
        camera,
        width=camera.width // step,
        height=camera.height // step,
        fx=camera.fx / step,
        fy=camera.fy / step,
        cx=camera.cx / step,
        cy=camera.cy / step,
    )


def averaged(planes: NDArray[np.float32], step: int, space: BlurSpace = "srgb") -> NDArray[np.float32]:
    """[C, H, W] averaged over step x step px, in the space in which the blur is linear."""
    if step == 1:
        return planes
    c, h, w = planes.shape
    h, w = h // step, w // step
    if space == "linear":
        planes = np.asarray(srgb_to_linear(planes), np.float32)
    # Sums of whole planes: reducing axes of two or three elements is ten times slower.
    out = np.zeros((c, h, w), np.float32)
    for row in range(step):
        for column in range(step):
            out += planes[:, row : h * step : step, column : w * step : step]
    out *= np.float32(1.0 / step**2)
    return np.asarray(linear_to_srgb(out), np.float32) if space == "linear" else out


def coarse_view(view: View, step: int, space: BlurSpace = "srgb") -> View:
    """The view of a photo averaged over `step` x `step` px, in 16 bits; the very same one for a step of 1.

    A px counts if all that it is averaged from do.
    """
    if step == 1:
        return view
    photo = np.round(averaged(view.planes(), step, space).clip(0.0, 1.0) * 65535.0).astype(np.uint16)
    mask = None if view.mask is None else averaged(view.mask[None].astype(np.float32), step)[0] > GRID.valid_share
    levels = view.levels or int(np.iinfo(view.photo.dtype).max)
    camera, pixels = coarse_camera(view.camera, step), np.ascontiguousarray(photo.transpose(1, 2, 0))
    empty = view.transparency()
    alpha = None if empty is None else np.uint16(65535) - _sixteen_bit(averaged(empty[None], step)[0])
    return replace(view, camera=camera, photo=pixels, mask=mask, levels=levels, alpha=alpha)


def _sixteen_bit(share: NDArray[np.float32]) -> NDArray[np.uint16]:
    return np.asarray(np.round(share * np.float32(65535)), np.uint16)


_ONE_BY_ONE = Lock()


@lru_cache(maxsize=1024)
def _kept_on_grid(psf: PointSpread, step: int) -> PointSpread:
    return psf.on_grid(step)


def _on_grid(psf: PointSpread, step: int) -> PointSpread:
    """Kept, so that views with the same point spread get the same object, and share their objective."""
    with _ONE_BY_ONE:  # (views are made side by side)
        return _kept_on_grid(psf, step)


class GridView:
    """One view on the grid: its camera, photo [3, h, w], validity, and point spread.

    The photo is kept in 16 bits (an eighth of a 14-bit sensor's step), which halves the memory of a
    large set, and on disk where the photo is; `planes` gives it in float32.
    """

    def __init__(self, view: View, camera: Camera, step: int, psf: PointSpread | None, space: BlurSpace) -> None:
        self.name = view.name
        self.camera = coarse_camera(camera, step)
        self.psf = None if psf is None or psf.is_identity else _on_grid(psf, step)
        planes = averaged(view.planes(), step, space)
        self._photo = kept_beside(view.photo, np.round(planes * np.float32(65535)).astype(np.uint16))
        self._valid: NDArray[np.bool_] | None = None
        if view.mask is not None and not view.mask.all():
            share = averaged(view.mask[None].astype(np.float32), step)[0]
            # A grid pixel counts if all its photo pixels do.
            self._valid = kept_beside(view.photo, share > GRID.valid_share)
        self._background, empty = view.background, view.transparency()
        # Alpha is averaged as it is: the photo over its background is linear in it in the space it is put over it.
        share_empty = None if empty is None else _sixteen_bit(averaged(empty[None], step)[0])
        self._empty = None if share_empty is None else kept_beside(view.photo, share_empty)

    @property
    def valid(self) -> NDArray[np.bool_] | None:
        """[h, w] px that count; None where all do."""
        return None if self._valid is None else np.array(self._valid)

    @property
    def opaque(self) -> bool:
        """Whether it is the same whatever colour lies behind it."""
        return self._empty is None or self._background is None

    def is_photo_of(self, other: GridView) -> bool:
        """Whether both show the very same photo, whatever their cameras."""
        return self._photo is other._photo

    def planes(self) -> NDArray[np.float32]:
        """The photo as [3, h, w] float32 in [0, 1], sRGB-encoded."""
        return self._photo.astype(np.float32) * np.float32(1 / 65535)

    def present(self) -> NDArray[np.float32] | None:
        """[h, w] share of each px that shows the object; None where the photo is opaque."""
        if self._empty is None or self._background is None:
            return None
        return np.float32(1) - self._empty.astype(np.float32) * np.float32(1 / 65535)

    def over(self, colour: Colour) -> NDArray[np.float32]:
        """`planes` with another sRGB colour in [0, 1] behind it; the same where the photo is opaque."""
        planes = self.planes()
        if self._empty is None or self._background is None:  # (`opaque`)
            return planes
        return over_another(self._background, planes, self._empty.astype(np.float32) * np.float32(1 / 65535), colour)

    def seen_by(self, camera: Camera) -> GridView:
        """The same photo, its camera (on the grid) elsewhere."""
        moved = copy(self)
        moved.camera = camera
        return moved

    def blurred_by(self, psf: PointSpread | None) -> GridView:
        """The same photo through another point spread (on the grid)."""
        other = copy(self)
        other.psf = psf
        return other
