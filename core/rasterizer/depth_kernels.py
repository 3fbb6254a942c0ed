"""Blending depths instead of colours: where along each px's ray the light is held back.

A splat's depth is the place along the ray where its Gaussian is densest, not the depth of its centre: a flat splat
that is seen from aside then lies where its plane lies (Yu et al. 2024, Gaussian Opacity Fields, eq. 6).
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..constants import TILE, TILE_ROWS, TRANSMITTANCE_STOP
from .blending_kernels import on_cache_lines, passes_less
from .ray_kernels import RAY_WIDTH
from .splat_kernels import (
    E_,
    GAUSSIAN,
    PIXELS,
    PLANE,
    Q_,
    S_,
    SPLAT_WIDTH,
    T_,
    blend_depth,
    hold_back,
    prefetch,
    rows_in_tile,
)

f32 = np.float32

#: After so many Gaussians a tile is asked whether anything passes it.
_LOOK = 8

# Planes of the output.
EXPECTED, SQUARE, LEVEL, TRANSMITTANCE, PLANES = 0, 1, 2, 3, 4


@kernel
def blend_depths(begin, end, splats, rays, lens, tile_starts, pairs, alpha_minimum, level, tiles_x, out):  # type: ignore[no-untyped-def]
    """Blends tiles `begin` to `end`.

    Args:
        splats: [N, 16] projected Gaussians; rays: [N, 16] float32, see `place_rays`.
        lens: [4] float32, fx, fy, cx, cy.
        tile_starts, pairs: the tiles' lists, front to back.
        level: transmittance at which the surface is.
        out: [4, H, W] output: sums of weight x depth and weight x depth^2, the depth at which transmittance falls
            through `level` (0 where it does not), and the transmittance.
    """
    height, width = out.shape[1:]
    state = on_cache_lines(4 * PLANE)
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        rows, columns = min(TILE_ROWS, height - top), min(TILE, width - left)
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        state[: rows * TILE] = f32(1.0)
        state[rows * TILE : PIXELS] = f32(0.0)
        state[PIXELS:] = f32(0.0)
        first, last = tile_starts[tile], tile_starts[tile + 1]
        for position in range(first, last):
            if (position - first) % _LOOK == 0:
                if passes_less(state, f32(TRANSMITTANCE_STOP)):
                    break
                for i in range(position + _LOOK, min(position + 2 * _LOOK, last)):
                    g = np.int64(pairs[i, GAUSSIAN])
                    prefetch(splats, g * SPLAT_WIDTH)
                    prefetch(rays, g * RAY_WIDTH)
            g = np.int64(pairs[position, GAUSSIAN])
            above, below, stride = rows_in_tile(splats, g, x0, y0, np.int64(rows), alpha_minimum)
            if above < below:
                blend_depth(state, splats, rays, lens, g, x0, y0, above, below, stride, alpha_minimum, level)
        for row in range(rows):
            for column in range(columns):
                at = row * TILE + column
                out[EXPECTED, top + row, left + column] = state[E_ + at]
                out[SQUARE, top + row, left + column] = state[Q_ + at]
                out[LEVEL, top + row, left + column] = state[S_ + at]
                out[TRANSMITTANCE, top + row, left + column] = state[T_ + at]


@kernel
def find_surface(begin, end, splats, tile_starts, pairs, alpha_minimum, level, tiles_x, out):  # type: ignore[no-untyped-def]
    """Where the light that passes falls through `level` in tiles `begin` to `end`, each Gaussian at its centre's depth.

    Args:
        splats, tile_starts, pairs: as of `blend_depths`.
        out: [H, W] output, 0 where it does not.
    """
    height, width = out.shape
    state = on_cache_lines(2 * PLANE)
    beneath = np.nextafter(level, f32(1.0))
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        rows, columns = min(TILE_ROWS, height - top), min(TILE, width - left)
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        state[: rows * TILE] = f32(1.0)
        state[rows * TILE : PIXELS] = f32(0.0)
        state[S_ : S_ + PIXELS] = f32(0.0)
        first, last = tile_starts[tile], tile_starts[tile + 1]
        for position in range(first, last):
            if (position - first) % _LOOK == 0:
                if passes_less(state, beneath):
                    break
                for i in range(position + _LOOK, min(position + 2 * _LOOK, last)):
                    prefetch(splats, np.int64(pairs[i, GAUSSIAN]) * SPLAT_WIDTH)
            g = np.int64(pairs[position, GAUSSIAN])
            above, below, stride = rows_in_tile(splats, g, x0, y0, np.int64(rows), alpha_minimum)
            if above < below:
                hold_back(state, splats, g, x0, y0, above, below, stride, alpha_minimum, level)
        for row in range(rows):
            for column in range(columns):
                out[top + row, left + column] = state[S_ + row * TILE + column]


__all__ = ["TRANSMITTANCE", "EXPECTED", "LEVEL", "PLANES", "SQUARE", "blend_depths", "find_surface"]
