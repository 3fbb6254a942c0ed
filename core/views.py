"""A photo with its camera: what the optimizer compares the twin with."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .background import Background
from .camera import Camera
from .compositing import opacity


@dataclass(frozen=True)
class View:
    """One photo, undistorted, and where it was taken from.

    Attributes:
        camera: pinhole camera; its width and height are the photo's.
        photo: [H, W, 3] uint8 or uint16, sRGB-encoded; over `background` where it is transparent.
        mask: [H, W] bool, True where a pixel counts; None where all do.
        levels: largest value of the file that the photo came from (255, 65535): `photo` may be finer, where it
            was resampled; None for `photo`'s own.
        alpha: [H, W] of the type of `photo`, 0 where it is empty; None where it is opaque everywhere.
        background: what is behind what all photos of the set show; None if that is not known.
        content: digests of the files that it came from (photo and mask); '' where it came from none.
    """

    camera: Camera
    photo: NDArray[np.uint8] | NDArray[np.uint16] = field(repr=False)
    mask: NDArray[np.bool_] | None = field(default=None, repr=False)
    levels: int | None = None
    alpha: NDArray[np.uint8] | NDArray[np.uint16] | None = field(default=None, repr=False)
    background: Background | None = None
    content: str = ""

    @property
    def rounding(self) -> float:
        """Standard deviation of the file's rounding, in [0, 1] units: the least noise there can be."""
        return 1.0 / (self.levels or int(np.iinfo(self.photo.dtype).max)) / 12.0**0.5

    @property
    def name(self) -> str:
        """File name of the photo."""
        return self.camera.name

    def planes(self) -> NDArray[np.float32]:
        """The photo as [3, H, W] float32 in [0, 1], still sRGB-encoded."""
        full = np.float32(np.iinfo(self.photo.dtype).max)
        return np.ascontiguousarray(self.photo.transpose(2, 0, 1)).astype(np.float32) / full

    def transparency(self) -> NDArray[np.float32] | None:
        """[H, W] how far the photo is empty, 1 - alpha; None where it is opaque everywhere."""
        return None if self.alpha is None else 1 - opacity(self.alpha)


def fingerprint(photo: NDArray[np.uint8] | NDArray[np.uint16]) -> int:
    """A number that two photos share if they are copies of one another (every 8th px is looked at)."""
    return zlib.crc32(np.ascontiguousarray(photo[::8, ::8]).tobytes() + str(photo.shape).encode())


def heldout_names(names: Sequence[str], every: int) -> list[str]:
    """Views 0, n, 2n ... by sorted name; none if `every` is 0."""
    return sorted(names)[::every] if every > 0 else []


def first_copies(views: Sequence[View]) -> list[View]:
    """The views in their order, of copies of a photo only the first."""
    found: dict[int, View] = {}
    for view in views:
        found.setdefault(fingerprint(view.photo), view)
    return list(found.values())


@dataclass(frozen=True)
class SparsePoints:
    """Points that structure from motion (or a camera file) came with, or samples of the surfaces that photos show.

    Attributes:
        positions: [M, 3] float64, world units.
        colours: [M, 3] uint8, sRGB-encoded.
        confidence: [M] float32 in (0, 1], where the points are dense samples of surfaces: how sure it is that a surface
            is there. None where they are sparse: surfaces lie between them.
        samples: dense samples of the surfaces between sparse points, with a confidence, where those were looked for.
        error_px: mean reprojection error of the features that a camera file's points come from, px of its lenses; NaN
            where it does not say.
    """

    positions: NDArray[np.float64]
    colours: NDArray[np.uint8]
    confidence: NDArray[np.float32] | None = None
    samples: SparsePoints | None = None
    error_px: float = float("nan")

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> SparsePoints:
        """Some of the points, by a mask [M] or by their indices; without samples."""
        sure = None if self.confidence is None else self.confidence[which]
        return SparsePoints(self.positions[which], self.colours[which], sure)
