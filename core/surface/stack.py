"""Small pinhole views of all photos in one stack: what a first surface is sought on."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import compiled
from ..camera import Camera
from ..compositing import Pixels
from ..imaging.medium import Medium
from ..numbers import number
from ..photos.empty import background_shows
from ..photos.load import Photo
from ..photos.scale import resized, resized_mask, size_within
from ..photos.undistort import undistorted_views
from ..reconstruction import Reconstruction
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from ..sfm.sharpen import luma, wiener
from ..views import View

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StackSettings:
    """Of the small views."""

    longest_side: int = number(
        256,
        "px",
        "of a small view: twice as many take eight times as long; the training finds what is finer",
        FIRST_TRIED,
        LOOKED_AT,
    )
    noise_to_signal: float = number(
        1.0e-3,
        "power ratio",
        "of the Wiener filter on small views; larger: less noise, less fine detail",
        FIRST_TRIED,
        LOOKED_AT,
    )
    shown: float = number(
        0.01,
        "share",
        "of a small px that shows more than background: less is none. With half of it wires vanished, and the hull that"
        " is carved had no room for them",
        "the orrery with small views of 160 px, 20 s: 24.2 dB -> 29.7",
        "drafts at the usual side: lego +0.07 dB, lego with alpha -0.08, plant -0.03",
    )


SETTINGS = StackSettings()


@dataclass(frozen=True)
class ViewStack:
    """All views, padded to one size.

    Attributes:
        names: [V] of the photos.
        sizes: [V, 2] int32 width, height.
        projections, offsets: [V, 3, 3], [V, 3] float64: (u z, v z, z) = projection @ world + offset.
        rotations, centres: [V, 3, 3] world to camera, [V, 3] positions.
        inverse: [V, 3, 3]: world direction of depth 1 = inverse @ (u, v, 1).
        focals: [V] px.
        grey: [V, H, W] float32, sharpened luma in about [0, 1].
        colours: [V, H, W, 3] uint8.
        counts: [V, H, W] bool, px that the photo shows and that count.
        empty: [V, H, W] bool, px that show nothing but the background; None where no photo says so.
    """

    names: tuple[str, ...]
    sizes: NDArray[np.int32]
    projections: Floats
    offsets: Floats
    rotations: Floats
    centres: Floats
    inverse: Floats
    focals: Floats
    grey: NDArray[np.float32] = field(repr=False)
    colours: NDArray[np.uint8] = field(repr=False)
    counts: NDArray[np.bool_] = field(repr=False)
    empty: NDArray[np.bool_] | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.names)

    def depths(self, view: int, positions: Floats) -> tuple[Floats, Floats]:
        """Px [K, 2] and depth [K] of the points that lie inside the frame."""
        p = positions @ self.projections[view].T + self.offsets[view]
        p = p[p[:, 2] > 0]
        pixels = p[:, :2] / p[:, 2:]
        inside = ((pixels >= 0) & (pixels < self.sizes[view])).all(axis=1)
        return pixels[inside], p[inside, 2]

    def lifted(self, view: int, pixels: Floats, depth: Floats) -> Floats:
        """[K, 3] points at a depth [K] behind px [K, 2]."""
        rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ self.inverse[view].T
        return np.asarray(rays * depth[:, None] + self.centres[view])


def stack_views(
    photos: Sequence[Photo], cameras: Reconstruction, medium: Medium, settings: StackSettings = SETTINGS
) -> ViewStack:
    """The photos that have a camera, small, straightened and sharpened, in their order."""
    seen = [photo for photo in photos if photo.name in cameras.poses]
    with ThreadPoolExecutor(compiled.threads()) as pool:
        small = list(pool.map(lambda photo: _shrunk(photo, settings.longest_side), seen))
    lenses = {p.name: cameras.lenses[p.name].resized(*p.size) for p in small}
    views = undistorted_views(small, replace(cameras, lenses=lenses))
    width, height = (max(getattr(v.camera, side) for v in views) for side in ("width", "height"))
    count = len(views)
    grey = np.zeros((count, height, width), np.float32)
    colours = np.zeros((count, height, width, 3), np.uint8)
    counts, empty = np.zeros((2, count, height, width), bool)

    def fill(index: int) -> None:
        view, photo = views[index], seen[index]
        inside = (index, slice(0, view.camera.height), slice(0, view.camera.width))
        grey[inside] = _sharpened(view, photo.size[0] / view.camera.width, medium, settings)
        colours[inside] = view.photo if view.photo.dtype == np.uint8 else (view.photo >> 8).astype(np.uint8)
        counts[inside] = True if view.mask is None else view.mask
        nothing = background_shows(view)
        if nothing is not None:
            empty[inside] = nothing

    with ThreadPoolExecutor(compiled.threads()) as pool:
        list(pool.map(fill, range(count)))
    return ViewStack(
        tuple(view.name for view in views),
        np.array([(v.camera.width, v.camera.height) for v in views], np.int32),
        **_matrices([view.camera for view in views]),
        grey=grey,
        colours=colours,
        counts=counts,
        empty=empty if empty.any() else None,
    )


def stack_pictures(
    cameras: Sequence[Camera], pictures: Sequence[NDArray[np.float32]], counts: Sequence[NDArray[np.bool_]]
) -> ViewStack:
    """Pictures that are sharp and straight already, as they are; they have no colours here.

    Args:
        pictures: [H, W] float32 grey of each camera, in [0, 1]; counts: [H, W] px that count.
    """
    width, height = (max(getattr(camera, side) for camera in cameras) for side in ("width", "height"))
    shape = (len(cameras), height, width)
    grey, counted = np.zeros(shape, np.float32), np.zeros(shape, bool)
    for index, camera in enumerate(cameras):
        inside = (index, slice(0, camera.height), slice(0, camera.width))
        grey[inside], counted[inside] = pictures[index], counts[index]
    return ViewStack(
        tuple(camera.name for camera in cameras),
        np.array([(camera.width, camera.height) for camera in cameras], np.int32),
        **_matrices(cameras),
        grey=grey,
        colours=np.zeros((len(cameras), 0, 0, 3), np.uint8),
        counts=counted,
        empty=None,
    )


def _matrices(cameras: Sequence[Camera]) -> dict[str, Floats]:
    lenses = np.array([[[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]] for c in cameras])
    rotations = np.array([camera.rotation for camera in cameras])
    translations = np.array([camera.translation for camera in cameras])
    return {
        "projections": lenses @ rotations,
        "offsets": np.einsum("nij,nj->ni", lenses, translations),
        "rotations": rotations,
        "centres": np.array([camera.centre for camera in cameras]),
        "inverse": rotations.transpose(0, 2, 1) @ np.linalg.inv(lenses),
        "focals": np.sqrt(lenses[:, 0, 0] * lenses[:, 1, 1]),
    }


def _shrunk(photo: Photo, longest: int) -> Photo:
    width, height = size_within(*photo.size, longest)
    if (width, height) == photo.size:
        return photo
    mask = None if photo.mask is None else resized_mask(photo.mask, width, height)
    return replace(photo, pixels=resized(photo.pixels, width, height), mask=mask, alpha=_anything(photo, width, height))


def _anything(photo: Photo, width: int, height: int) -> Pixels | None:
    """[height, width] alpha, opaque where a photo shows anything within a small px: wires are thinner than those.

    None where the photo does not say what is empty.
    """
    nothing = background_shows(photo)
    if nothing is None:
        return None
    share = Image.fromarray((~nothing).astype(np.float32)).resize((width, height), Image.Resampling.BOX)
    alpha = np.asarray(share) > SETTINGS.shown
    return alpha * np.uint16(65535) if photo.pixels.dtype == np.uint16 else alpha * np.uint8(255)


def _sharpened(view: View, shrunk: float, medium: Medium, settings: StackSettings) -> NDArray[np.float32]:
    grey = luma(view.photo)
    psf = medium.psf_for(view.name)
    if psf is None or psf.is_identity:
        return grey
    kernel = psf.on_grid(max(1.0, shrunk)).kernel()
    return grey if kernel.size == 1 else wiener(grey, kernel, settings.noise_to_signal)
