"""Frames along a camera's path: where each Gaussian's centre is in every frame, and the tiles that it meets in any."""

from __future__ import annotations

import numpy as np

from ..compiled import exact, kernel
from ..constants import TILE, TILE_ROWS
from .projection_kernels import OUTSIDE, SEEN
from .shape_kernels import V_CX, V_CY, V_FX, V_FY, V_HEIGHT, V_NEAR, V_WIDTH
from .splat_kernels import GAUSSIAN, HALF_HEIGHT, RATIO, REACH, SHEAR, SLOT, SPLAT_WIDTH, SQUEEZE, TURN, X, Y, prefetch

f32 = np.float32
#: A centre that is in no frame: no tile's row reaches it.
NOWHERE = f32(-1e8)
# Layout of how far a Gaussian strays from where its splat stands, px: least and most along x and y.
LEAST_X, MOST_X, LEAST_Y, MOST_Y, STRAY_WIDTH = 0, 1, 2, 3, 4
#: For how many Gaussians ahead memory is asked for, as in `binning_kernels`.
_AHEAD = 16


@kernel
def follow(begin, end, means, splats, view, poses, status, radius, centres, strays, rows, tile_counts):  # type: ignore[no-untyped-def]
    """Where Gaussians `begin` to `end` are in each frame, and how many tiles they meet in any.

    Args:
        splats: [N, 16] as `project` wrote them for a larger frame around the photo's.
        view: [25] float64 of the photo itself: its lens and frame are read.
        poses: [K, 12] float64 rotation row by row, translation.
        status, radius: of `project`; changed where a Gaussian is in none of the frames.
        centres: [K, N, 2] float32 output, px; `NOWHERE` where there is none.
        strays: [N, 4] float32 output, see `LEAST_X`.
        rows: [N, 2] int16 output, first row of tiles and one past the last; tile_counts: [N] int32 output.
    """
    fx, fy, cx, cy, near = view[V_FX], view[V_FY], view[V_CX], view[V_CY], view[V_NEAR]
    width, height = f32(view[V_WIDTH]), f32(view[V_HEIGHT])
    for g in range(begin, end):
        strays[g, LEAST_X] = strays[g, LEAST_Y] = f32(1e8)
        strays[g, MOST_X] = strays[g, MOST_Y] = f32(-1e8)
        rows[g, 0] = rows[g, 1] = 0
        tile_counts[g] = 0
        if status[g] != SEEN:
            continue
        x, y, z = np.float64(means[g, 0]), np.float64(means[g, 1]), np.float64(means[g, 2])
        for k in range(poses.shape[0]):
            p = poses[k]
            depth = p[6] * x + p[7] * y + p[8] * z + p[11]
            u = v = NOWHERE
            if depth > near:
                u = f32(fx * (p[0] * x + p[1] * y + p[2] * z + p[9]) / depth + cx)
                v = f32(fy * (p[3] * x + p[4] * y + p[5] * z + p[10]) / depth + cy)
                across, down = u - splats[g, X], v - splats[g, Y]
                strays[g, LEAST_X], strays[g, MOST_X] = min(strays[g, LEAST_X], across), max(strays[g, MOST_X], across)
                strays[g, LEAST_Y], strays[g, MOST_Y] = min(strays[g, LEAST_Y], down), max(strays[g, MOST_Y], down)
            centres[k, g, 0], centres[k, g, 1] = u, v
        first, last = swept_rows(splats, strays, g, height)
        met = 0
        for row in range(first, last):
            left, right = swept_columns(splats, strays, g, row, width)
            met += right - left
        rows[g, 0], rows[g, 1] = first, last
        tile_counts[g] = met
        if met == 0:
            status[g] = OUTSIDE
            radius[g] = f32(0.0)


@exact
def swept_rows(splats, strays, g, height):  # type: ignore[no-untyped-def]
    """First and one past the last row of tiles that the ellipse's box reaches in any frame."""
    y, half = splats[g, Y] - f32(0.5), splats[g, HALF_HEIGHT]
    first = np.ceil(min(max(y + strays[g, LEAST_Y] - half, f32(0.0)), height))
    last = np.floor(min(max(y + strays[g, MOST_Y] + half, f32(-1.0)), height - f32(1.0)))
    if not first <= last:
        return 0, 0
    return int(first) // TILE_ROWS, int(last) // TILE_ROWS + 1


@exact
def swept_columns(splats, strays, g, row, width):  # type: ignore[no-untyped-def]
    """First and one past the last tile in a row of tiles that the ellipse may meet in any frame.

    As `projection_kernels.tile_columns`, of all ellipses whose centre is in the box that the frames' centres span.
    """
    ratio = splats[g, RATIO]
    shear, squeeze, reach = splats[g, SHEAR] * ratio, splats[g, SQUEEZE] * ratio * ratio, splats[g, REACH] * ratio
    low = f32(row * TILE_ROWS) + f32(0.5) - splats[g, Y] - strays[g, MOST_Y]
    high = f32(row * TILE_ROWS) + f32(TILE_ROWS - 0.5) - splats[g, Y] - strays[g, LEAST_Y]
    right = min(max(splats[g, TURN], low), high)
    left = min(max(-splats[g, TURN], low), high)
    beyond, before = reach - squeeze * right * right, reach - squeeze * left * left
    if not (beyond >= f32(0.0) and before >= f32(0.0)):
        return 0, 0
    x = splats[g, X] - f32(0.5)
    first = np.ceil(min(max(x + strays[g, LEAST_X] + shear * left - np.sqrt(before), f32(0.0)), width))
    last = np.floor(min(max(x + strays[g, MOST_X] + shear * right + np.sqrt(beyond), f32(-1.0)), width - f32(1.0)))
    if not first <= last:
        return 0, 0
    return int(first) // TILE, int(last) // TILE + 1


@kernel
def count_swept(begin, end, splats, strays, rows, order, chunk, tiles_x, width, steps):  # type: ignore[no-untyped-def]
    """As `binning_kernels.count_pairs`, of what the ellipses meet in any frame."""
    for part in range(begin, end):
        steps[part, :, :] = 0
        for i in range(part * chunk, min((part + 1) * chunk, order.shape[0])):
            g = order[i]
            for row in range(np.int64(rows[g, 0]), np.int64(rows[g, 1])):
                left, right = swept_columns(splats, strays, g, row, width)
                steps[part, row, left] += 1
                steps[part, row, right] -= 1


@kernel
def place_swept(begin, end, splats, strays, rows, order, chunk, tiles_x, width, slot_starts, places, pairs):  # type: ignore[no-untyped-def]
    """As `binning_kernels.place_pairs`, of what the ellipses meet in any frame."""
    for part in range(begin, end):
        stop = min((part + 1) * chunk, order.shape[0])
        for i in range(part * chunk, stop):
            prefetch(splats, np.int64(order[min(i + _AHEAD, stop - 1)]) * SPLAT_WIDTH)
            g = order[i]
            slot = slot_starts[g]
            for row in range(np.int64(rows[g, 0]), np.int64(rows[g, 1])):
                left, right = swept_columns(splats, strays, g, row, width)
                for column in range(left, right):
                    to = places[part, row, column]
                    places[part, row, column] = to + 1
                    pairs[to, GAUSSIAN] = g
                    pairs[to, SLOT] = slot
                    slot += 1


@kernel
def moved_splats(begin, end, splats, centres, moved):  # type: ignore[no-untyped-def]
    """Splats `begin` to `end` [N, 16] with the centres [N, 2] of a frame."""
    for g in range(begin, end):
        moved[g, :] = splats[g, :]
        moved[g, X], moved[g, Y] = centres[g, 0], centres[g, 1]
