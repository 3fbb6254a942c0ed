"""Turns photos into pinhole views, and renders back into the photos' own lenses."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import spline_filter1d

from .. import compiled
from ..camera import Camera
from ..compositing import Pixels, opacity
from ..errors import CameraError
from ..lens import Lens
from ..numbers import BY_DEFINITION, number
from ..pose import Pose
from ..reconstruction import Reconstruction
from ..views import View
from .load import Photo
from .resample_kernels import sample
from .store import kept_beside

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class UndistortionSettings:
    """Of the way from a lens to a pinhole."""

    untouched: float = number(
        0.05, "px", "distortion below this, anywhere in the frame, is not worth touching a pixel for"
    )
    kept_px: int = number(
        2_000_000, "px", "maps of lenses with at most so many are kept from one call to the next (32 MB)", BY_DEFINITION
    )
    farthest: float = number(
        4.0,
        "longest sides",
        "beyond the frame that the border may look: a fisheye of 170 degrees needs 3.4",
        BY_DEFINITION,
    )
    folded: float = number(
        1e-4, "focal lengths", "where a lens does not map back to within this, its polynomial has folded over"
    )


SETTINGS = UndistortionSettings()


@dataclass(frozen=True)
class Undistortion:
    """The way from a photo's lens to the pinhole camera of the same frame, and back.

    The pinhole keeps the photo's size, focal lengths and principal point, so that the middle of
    the photo keeps its sampling (and its point spread function).

    Attributes:
        lens: the photo's.
    """

    lens: Lens

    @cached_property
    def passes_through(self) -> bool:
        """Whether photos stay bitwise what they are."""
        return self.lens.largest_shift() < SETTINGS.untouched

    @cached_property
    def overscan(self) -> int:
        """Pixels beyond the pinhole's frame, on each side, that the photo's border looks at.

        Raises:
            CameraError: no ray reaches the border, or from so far that no render could hold it.
        """
        if self.passes_through:
            return 0
        lens = self.lens
        across, down = np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5
        border = np.concatenate(
            [
                np.stack([across, np.full_like(across, 0.5)], 1),
                np.stack([across, np.full_like(across, lens.height - 0.5)], 1),
                np.stack([np.full_like(down, 0.5), down], 1),
                np.stack([np.full_like(down, lens.width - 0.5), down], 1),
            ]
        )
        ideal = lens.from_pixels(border) * [lens.fx, lens.fy] + [lens.cx, lens.cy]
        beyond = np.maximum(-ideal, ideal - [lens.width, lens.height])
        reached = np.isfinite(beyond)
        farthest = float(beyond[reached].max()) if reached.any() else math.inf
        if farthest > SETTINGS.farthest * max(lens.width, lens.height):
            raise CameraError(
                f"The distortion of the lens '{lens.model}' with the parameters {lens.params} makes no sense",
                "Export the cameras again, or let them be found from the photos",
            )
        return max(0, math.ceil(farthest))

    def camera(self, name: str, pose: Pose) -> Camera:
        """The pinhole camera of the undistorted photo."""
        lens = self.lens
        return Camera(
            name, lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, pose.rotation, pose.translation
        )

    @cached_property
    def _sources(self) -> Floats:
        """[H, W, 2] where each pixel of the pinhole lies in the photo (px)."""
        lens = self.lens
        u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
        uv = np.stack([u, v], axis=-1)
        xy = (uv - [lens.cx, lens.cy]) / [lens.fx, lens.fy]
        at = lens.to_pixels(xy)
        # A polynomial may fold back: only what the lens maps back to itself is real.
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            back = lens.from_pixels(np.clip(at, -lens.width, 2 * lens.width))
        return np.where((np.abs(back - xy) < SETTINGS.folded).all(-1, keepdims=True), at, np.nan)

    @cached_property
    def _targets(self) -> Floats:
        """[H, W, 2] where each pixel of the photo lies in the pinhole's frame (px)."""
        lens = self.lens
        u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
        return np.asarray(lens.from_pixels(np.stack([u, v], -1)) * [lens.fx, lens.fy] + [lens.cx, lens.cy])

    def prepare(self) -> None:
        """Computes the maps now, before several threads ask for them at once."""
        if not self.passes_through:
            _ = self._sources, self.overscan

    def photo(
        self, pixels: NDArray[np.uint8] | NDArray[np.uint16], mask: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.uint8] | NDArray[np.uint16], NDArray[np.bool_] | None]:
        """Undistorted photo (uint16 where it was resampled) and mask; pixels that the photo did not see do not count.

        Args:
            pixels: [H, W, 3]; interpolated in their sRGB encoding, as the blur acts there.
            mask: [H, W] or None.
        """
        if self.passes_through:
            return pixels, mask
        full = np.iinfo(pixels.dtype).max
        straight = resample(pixels.astype(np.float32), self._sources)
        counts = _inside(self._sources, self.lens.width, self.lens.height)
        if mask is not None:
            weight = resample(mask.astype(np.float32)[:, :, None], self._sources, prefilter=False)[:, :, 0]
            counts &= weight >= 0.5
        # In 16 bits: a second rounding to 8 adds noise whose stripes the inverted blur would amplify (it cost
        # the ball 1.3 dB at full trust).
        rounded: NDArray[Any] = np.clip(straight * (65535.0 / full) + 0.5, 0, 65535).astype(np.uint16)
        kept = None if counts.all() else counts
        return rounded, kept

    def alpha(self, alpha: Pixels) -> Pixels:
        """Alpha [H, W] of the undistorted photo, of the type that `photo` gives."""
        if self.passes_through:
            return alpha
        straight = resample(opacity(alpha)[:, :, None], self._sources)[:, :, 0]
        return np.asarray(np.clip(straight * 65535.0 + 0.5, 0, 65535), np.uint16)

    def render(self, image: NDArray[np.float32], margin: int) -> NDArray[np.float32]:
        """A render of the pinhole, as the photo's lens would have seen it.

        Args:
            image: [3, H + 2 margin, W + 2 margin] float32, any space.
            margin: pixels beyond the frame on every side; `overscan` + 3 covers every pixel.

        Returns:
            [3, H, W] float32 that lines up with the photo; pixels beyond the margin repeat its edge.
        """
        height, width = self.lens.height, self.lens.width
        if image.shape[1:] != (height + 2 * margin, width + 2 * margin):
            raise ValueError(f"image {image.shape} does not fit {width} x {height} with margin {margin}")
        if self.passes_through:
            return np.ascontiguousarray(image[:, margin : margin + height, margin : margin + width])
        at = np.clip(self._targets + margin, 0.5, [width + 2 * margin - 0.5, height + 2 * margin - 0.5])
        return np.ascontiguousarray(resample(image.transpose(1, 2, 0), at).transpose(2, 0, 1))


def resample(image: NDArray[np.float32], at: Floats, prefilter: bool = True) -> NDArray[np.float32]:
    """Quintic B-spline interpolation.

    Args:
        image: [H, W, C] float32.
        at: [h, w, 2] px, pixel centres at +0.5; NaN or outside gives 0.
        prefilter: False smooths (for masks) instead of interpolating.
    """
    coefficients = image
    if prefilter:
        for axis in (0, 1):
            if image.shape[axis] > 1:
                coefficients = spline_filter1d(coefficients, 5, axis=axis, output=np.float64, mode="mirror")
    out = np.empty((*at.shape[:2], image.shape[2]), np.float32)
    compiled.run(
        sample,
        at.shape[0],
        np.ascontiguousarray(coefficients, np.float32),
        np.ascontiguousarray(at, np.float64),
        out,
        grain=16,
    )
    return out


def _inside(at: Floats, width: int, height: int) -> NDArray[np.bool_]:
    x, y = at[..., 0], at[..., 1]
    return np.asarray((x >= 0) & (y >= 0) & (x <= width) & (y <= height))


@lru_cache(maxsize=2)
def _kept(lens: Lens) -> Undistortion:
    return Undistortion(lens)


def _way(lens: Lens) -> Undistortion:
    """A lens's maps: they take as long as two photos, and are kept if they are small."""
    return _kept(lens) if lens.width * lens.height <= SETTINGS.kept_px else Undistortion(lens)


def undistorted_views(photos: list[Photo], cameras: Reconstruction) -> list[View]:
    """The photos that have a camera, as pinhole views, in the order of `photos`.

    Photos without noticeable distortion share their pixels with the `Photo` (bitwise the same).
    """
    seen = [photo for photo in photos if photo.name in cameras.poses]
    shared = {lens: _way(lens) for lens in {cameras.lenses[photo.name] for photo in seen}}

    def one(photo: Photo) -> View:
        way = shared[cameras.lenses[photo.name]]
        pixels, mask = way.photo(photo.pixels, photo.mask)
        pixels, mask = kept_beside(photo.pixels, pixels), None if mask is None else kept_beside(photo.pixels, mask)
        levels = int(np.iinfo(photo.pixels.dtype).max)
        alpha = None if photo.alpha is None else kept_beside(photo.pixels, way.alpha(photo.alpha))
        camera = way.camera(photo.name, cameras.poses[photo.name])
        return View(camera, pixels, mask, levels, alpha, photo.background, photo.content)

    if all(way.passes_through for way in shared.values()):
        return [one(photo) for photo in seen]
    for way in shared.values():
        way.prepare()
    with ThreadPoolExecutor(compiled.threads()) as pool:
        return list(pool.map(one, seen))
