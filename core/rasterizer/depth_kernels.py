"""Blending depths instead of colours: where along each px's ray the light is held back.

A splat's depth is the place along the ray where its Gaussian is densest, not the depth of its centre: a flat splat
that is seen from aside then lies where its plane lies (Yu et al. 2024, Gaussian Opacity Fields, eq. 6).
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..constants import ALPHA_MAXIMUM, TILE, TILE_ROWS, TRANSMITTANCE_STOP
from .blending_kernels import on_cache_lines, passes_less
from .splat_kernels import (
    CONIC,
    GAUSSIAN,
    OPACITY,
    PIXELS,
    PLANE,
    S_,
    SHEAR,
    SPLAT_WIDTH,
    SQUEEZE,
    X,
    Y,
    hold_back,
    prefetch,
    rows_in_tile,
)

f32 = np.float32

#: After so many Gaussians a tile is asked whether anything passes it.
_LOOK = 8

# Layout of a Gaussian's row of `rays`: K [3, 3] row by row, K m [3], and the depths that it may lie between.
K_M, LOW, HIGH, RAY_WIDTH = 9, 12, 13, 16
# Planes of the output.
EXPECTED, SQUARE, LEVEL, TRANSMITTANCE, PLANES = 0, 1, 2, 3, 4


@kernel
def blend_depths(begin, end, splats, rays, lens, tile_starts, pairs, alpha_minimum, level, tiles_x, out):  # type: ignore[no-untyped-def]
    """Blends tiles `begin` to `end`.

    Args:
        splats: [N, 16] projected Gaussians; rays: [N, 16] float32, see `K_M`.
        lens: [4] float32, fx, fy, cx, cy.
        tile_starts, pairs: the tiles' lists, front to back.
        level: transmittance at which the surface is.
        out: [4, H, W] output: sums of weight x depth and weight x depth^2, the depth at which transmittance falls
            through `level` (0 where it does not), and the transmittance.
    """
    height, width = out.shape[1:]
    for tile in range(begin, end):
        top, left = (tile // tiles_x) * TILE_ROWS, (tile % tiles_x) * TILE
        rows, columns = min(TILE_ROWS, height - top), min(TILE, width - left)
        part = out[:, top : top + rows, left : left + columns]
        part[:TRANSMITTANCE] = f32(0.0)
        part[TRANSMITTANCE] = f32(1.0)
        x0, y0 = f32(left) + f32(0.5), f32(top) + f32(0.5)
        for position in range(tile_starts[tile], tile_starts[tile + 1]):
            g = np.int64(pairs[position, GAUSSIAN])
            first, last, _ = rows_in_tile(splats, g, x0, y0, np.int64(rows), alpha_minimum)
            k = rays[g]
            steep, shear, squeeze = f32(-0.5) * splats[g, CONIC], splats[g, SHEAR], splats[g, SQUEEZE]
            for row in range(first, last):
                y = y0 + f32(row)
                dy = y - splats[g, Y]
                ray_y = (y - lens[3]) / lens[1]
                for column in range(columns):
                    clear = part[TRANSMITTANCE, row, column]
                    x = x0 + f32(column)
                    dx = x - splats[g, X]
                    u = dy - shear * dx
                    alpha = splats[g, OPACITY] * np.exp(steep * (u * u + squeeze * dx * dx))
                    if alpha < alpha_minimum or clear < f32(TRANSMITTANCE_STOP):
                        continue
                    alpha = min(alpha, f32(ALPHA_MAXIMUM))
                    ray_x = (x - lens[2]) / lens[0]
                    a = k[0] * ray_x + k[1] * ray_y + k[2]
                    b = k[3] * ray_x + k[4] * ray_y + k[5]
                    c = k[6] * ray_x + k[7] * ray_y + k[8]
                    depth = (a * k[K_M] + b * k[K_M + 1] + c * k[K_M + 2]) / (a * a + b * b + c * c)
                    depth = min(max(depth, k[LOW]), k[HIGH])
                    weight = alpha * clear
                    part[EXPECTED, row, column] += weight * depth
                    part[SQUARE, row, column] += weight * depth * depth
                    part[TRANSMITTANCE, row, column] = clear - weight
                    if clear > level and clear - weight <= level:
                        part[LEVEL, row, column] = depth


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


__all__ = [
    "TRANSMITTANCE",
    "EXPECTED",
    "HIGH",
    "K_M",
    "LOW",
    "LEVEL",
    "PLANES",
    "RAY_WIDTH",
    "SQUARE",
    "blend_depths",
    "find_surface",
]
