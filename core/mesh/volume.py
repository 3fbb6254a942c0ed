"""Depth maps fused to a field of signed distances: blocks of voxels, only where a surface is near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..compiled import run
from ..errors import DgsError
from ..numbers import number
from .fusion_kernels import SIDE, fuse, mark_blocks
from .surfaces import SeenSurface

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class VolumeSettings:
    """Of the field of distances."""

    reach: float = number(
        4.0,
        "voxels",
        "to either side of a surface in which distances are averaged",
        "the rendered ball, sharp: median error 0.43 px with 4, 0.49 with 8; views that see through a voxel as votes"
        " for emptiness: 0.65",
    )
    blocks: int = number(
        60000, "count", "of 512 voxels at most: 6 kB each, 370 MB; what needs more is made of larger voxels"
    )
    grid: int = number(1 << 27, "blocks", "of the whole grid at most, of which a byte each is kept: 128 MB")
    growth: float = number(1.2, "factor", "by which voxels grow until there are few enough")
    farthest: float = number(
        3.0,
        "voxels, or usual px where those are larger",
        "that a px may be large: surfaces beyond are too far off to be made of voxels of this size",
    )
    stride: float = number(2.0, "voxels", "between the px that say where blocks are needed")


@dataclass(frozen=True)
class Volume:
    """A field of signed distances.

    Attributes:
        low: [3] the grid's corner, world units; voxel: side of a voxel.
        blocks: [B, 3] int32 places of the blocks, in blocks.
        values: [B, 8, 8, 8] float32, distance to the surface in voxels, positive in front of it.
        weights: [B, 8, 8, 8] float32, 0 where nothing was seen.
        squares: [B, 8, 8, 8] float32, mean square of the distances that `values` is the mean of, voxels^2.
        far: share of the seen px whose surface is too far off to be here.
    """

    low: NDArray[np.float64]
    voxel: float
    blocks: NDArray[np.int32]
    values: Floats = field(repr=False)
    weights: Floats = field(repr=False)
    squares: Floats = field(repr=False)
    far: float

    @property
    def side(self) -> int:
        """Voxels along each side of a block."""
        return SIDE

    def places(self) -> NDArray[np.int64]:
        """[X, Y, Z] index of the block at each place, -1 where there is none; empty places all round the last ones."""
        where = np.full(self.blocks.max(axis=0) + 3, -1, np.int64)
        where[tuple(self.blocks.T)] = np.arange(len(self.blocks))
        return where


@dataclass(frozen=True)
class FlatViews:
    """All views as kernels take them.

    Attributes:
        depths, weights: [P] float32, px of all views behind each other; the largest weight is 1.
        starts: [V]; sizes: [V, 2] height and width; poses: [V, 12]; lenses: [V, 4].
    """

    depths: Floats
    weights: Floats
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]
    poses: NDArray[np.float64]
    lenses: NDArray[np.float64]


def flattened(surfaces: Sequence[SeenSurface]) -> FlatViews:
    """Puts views behind each other."""
    depths = np.concatenate([s.depth.ravel() for s in surfaces])
    weights = np.concatenate([s.weight.ravel() for s in surfaces])
    weights *= np.float32(1.0 / max(float(weights.max()), 1e-30))
    sizes = np.array([s.depth.shape for s in surfaces], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))[:-1]])
    poses, lenses = np.stack([_pose(s) for s in surfaces]), np.stack([_lens(s) for s in surfaces])
    return FlatViews(depths, weights, starts, sizes, poses, lenses)


def usual_voxel(surfaces: Sequence[SeenSurface]) -> float:
    """Median size of a px on the seen surfaces, world units.

    Raises:
        DgsError: no camera sees a surface.
    """
    pixels = [float(np.median(s.pixel[s.weight > 0])) for s in surfaces if (s.weight > 0).any()]
    if not pixels:
        raise DgsError("No camera sees a surface of the twin", "Check that the cameras are those of this twin")
    return float(np.median(pixels))


def fused(surfaces: Sequence[SeenSurface], voxel: float, settings: VolumeSettings = VolumeSettings()) -> Volume:
    """Fuses what the cameras see.

    Args:
        voxel: side of a voxel, world units; it is made larger where that would be too many.
    """
    usual = usual_voxel(surfaces)
    while True:
        farthest = [settings.farthest * max(voxel, usual) * s.camera.fx for s in surfaces]
        low, shape = _extent(surfaces, farthest, voxel * (settings.reach + 2))
        cells = float(np.prod(_cells(shape, voxel).astype(np.float64)))
        if cells <= settings.grid:
            marked = _marked(surfaces, farthest, voxel, low, _cells(shape, voxel), settings)
            blocks = np.argwhere(marked).astype(np.int32)
            if len(blocks) <= settings.blocks:
                break
        voxel *= max(settings.growth, (cells / settings.grid) ** (1 / 3))
    seen = sum(int((s.weight > 0).sum()) for s in surfaces)
    near = sum(int(((s.weight > 0) & (s.depth <= f)).sum()) for s, f in zip(surfaces, farthest, strict=True))
    shape4 = (len(blocks), SIDE, SIDE, SIDE)
    flat = [np.empty((len(blocks), SIDE**3), np.float32) for _ in range(3)]
    v = flattened(surfaces)
    reach = settings.reach * voxel
    arguments = (v.depths, v.weights, v.starts, v.sizes, v.poses, v.lenses, reach, *flat)
    run(fuse, len(blocks), blocks, low, voxel, *arguments, grain=16)
    values, total, square = (plane.reshape(shape4) for plane in flat)
    values *= np.float32(settings.reach)
    square *= np.float32(settings.reach**2)
    return Volume(low, voxel, blocks, values, total, square, 1.0 - near / max(1, seen))


def _cells(size: NDArray[np.float64], voxel: float) -> NDArray[np.int64]:
    return np.clip(np.ceil(size / (voxel * SIDE)), 1, 1e15).astype(np.int64)  # (an int64 holds no more)


def _extent(
    surfaces: Sequence[SeenSurface], farthest: Sequence[float], around: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """[3] low corner and [3] size of the box around what is near enough."""
    lows, highs = [], []
    for surface, far in zip(surfaces, farthest, strict=True):
        rows, columns = np.nonzero((surface.weight > 0) & (surface.depth <= far))
        if len(rows):
            axes = np.ascontiguousarray(points_of(surface, rows, columns).T)  # (numpy's minimum is slow down columns)
            lows.append(axes.min(axis=1))
            highs.append(axes.max(axis=1))
    if not lows:
        raise DgsError("All surfaces of the twin are too far off for voxels of this size", "Ask for less detail")
    low, high = np.min(lows, axis=0) - around, np.max(highs, axis=0) + around
    return low, high - low


def points_of(surface: SeenSurface, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
    """[n, 3] places of px on the surface, in the world."""
    camera, z = surface.camera, surface.depth[rows, columns].astype(np.float64)
    x, y = (columns + 0.5 - camera.cx) / camera.fx * z, (rows + 0.5 - camera.cy) / camera.fy * z
    return np.asarray((np.stack([x, y, z], axis=-1) - camera.translation) @ camera.rotation)


def _marked(
    surfaces: Sequence[SeenSurface],
    farthest: Sequence[float],
    voxel: float,
    low: NDArray[np.float64],
    shape: NDArray[np.int64],
    settings: VolumeSettings,
) -> NDArray[np.uint8]:
    marked = np.zeros(shape, np.uint8)
    for surface, far in zip(surfaces, farthest, strict=True):
        seen = surface.weight > 0
        if not seen.any():
            continue
        depth = np.where(seen, surface.depth, np.float32(0))
        pixel = float(np.median(surface.pixel[seen]))
        stride = max(1, int(settings.stride * voxel / pixel))
        lines = -(-depth.shape[0] // stride)
        reach = settings.reach * voxel
        run(mark_blocks, lines, depth, _pose(surface), _lens(surface), stride, reach, voxel, low, far, marked)
    return marked


def _pose(surface: SeenSurface) -> NDArray[np.float64]:
    return np.concatenate([surface.camera.rotation.ravel(), surface.camera.translation])


def _lens(surface: SeenSurface) -> NDArray[np.float64]:
    camera = surface.camera
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy])
