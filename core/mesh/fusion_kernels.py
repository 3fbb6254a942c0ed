"""Signed distances of voxels from many depth maps (Curless and Levoy 1996), in blocks of 8 x 8 x 8 voxels."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel

f32 = np.float32

#: Voxels along each side of a block.
SIDE = 8


@kernel
def mark_blocks(begin, end, depths, pose, lens, stride, reach, voxel, low, farthest, marked):  # type: ignore[no-untyped-def]
    """Marks the blocks that are near a view's surface; rows `begin` to `end` of every `stride`th.

    Args:
        depths: [H, W] float32; pose: [12] float64, R row by row and t, world to camera; lens: [4] fx, fy, cx, cy.
        reach: world units along the ray, to either side of the surface; voxel: world units.
        low: [3] the grid's corner; farthest: depth beyond which nothing counts.
        marked: [X, Y, Z] uint8 output, set to 1.
    """
    height, width = depths.shape
    side = voxel * SIDE
    steps = np.int64(np.ceil(2.0 * reach / voxel))
    for line in range(begin, end):
        row = line * stride
        for column in range(0, width, stride):
            depth = np.float64(depths[row, column])
            if not (depth > 0.0 and depth <= farthest):
                continue
            x, y = (column + 0.5 - lens[2]) / lens[0], (row + 0.5 - lens[3]) / lens[1]
            for step in range(steps + 1):
                z = depth + reach * (2.0 * step / steps - 1.0)
                p0, p1, p2 = x * z - pose[9], y * z - pose[10], z - pose[11]
                for corner in range(8):
                    # blocks that begin within half a voxel, too: a cell of theirs may hold this surface
                    a = voxel * (0.75 if corner & 1 else -0.75)
                    b = voxel * (0.75 if corner & 2 else -0.75)
                    c = voxel * (0.75 if corner & 4 else -0.75)
                    i = np.int64(np.floor((pose[0] * p0 + pose[3] * p1 + pose[6] * p2 - low[0] + a) / side))
                    j = np.int64(np.floor((pose[1] * p0 + pose[4] * p1 + pose[7] * p2 - low[1] + b) / side))
                    k = np.int64(np.floor((pose[2] * p0 + pose[5] * p1 + pose[8] * p2 - low[2] + c) / side))
                    if 0 <= i < marked.shape[0] and 0 <= j < marked.shape[1] and 0 <= k < marked.shape[2]:
                        marked[i, j, k] = 1


@kernel
def fuse(begin, end, blocks, low, voxel, depths, weights, starts, sizes, poses, lenses, reach, values, total, square):  # type: ignore[no-untyped-def]
    """Fuses all views into blocks `begin` to `end`.

    Args:
        blocks: [B, 3] int32, in blocks from the corner `low` [3]; voxel: world units.
        depths, weights: [P] float32, all views' px behind each other; starts: [V]; sizes: [V, 2] height and width.
        poses: [V, 12]; lenses: [V, 4] float64.
        reach: distance along the axis beyond which a surface says nothing about a voxel, world units.
        values, total, square: [B, 512] float32 output: mean signed distance in units of `reach`, the weights' sum (0:
            nothing was seen), and the mean of their squares.
    """
    one = f32(1.0)
    for block in range(begin, end):
        x0 = low[0] + (blocks[block, 0] * SIDE + 0.5) * voxel
        y0 = low[1] + (blocks[block, 1] * SIDE + 0.5) * voxel
        z0 = low[2] + (blocks[block, 2] * SIDE + 0.5) * voxel
        half = 0.5 * (SIDE - 1) * voxel
        radius = half * 1.7320508 + voxel
        mean, whole, squares = values[block], total[block], square[block]
        mean[:] = f32(0.0)
        whole[:] = f32(0.0)
        squares[:] = f32(0.0)
        for view in range(len(starts)):
            r, lens = poses[view], lenses[view]
            height, width = sizes[view, 0], sizes[view, 1]
            mx, my, mz = x0 + half, y0 + half, z0 + half
            cz = r[6] * mx + r[7] * my + r[8] * mz + r[11]
            if cz <= radius:
                continue
            u = lens[0] * (r[0] * mx + r[1] * my + r[2] * mz + r[9]) / cz + lens[2]
            v = lens[1] * (r[3] * mx + r[4] * my + r[5] * mz + r[10]) / cz + lens[3]
            wide = 2.0 * max(lens[0], lens[1]) * radius / (cz - radius)
            if u < -wide or v < -wide or u > width + wide or v > height + wide:
                continue
            for i in range(SIDE):
                for j in range(SIDE):
                    x, y, z = x0 + i * voxel, y0 + j * voxel, z0
                    px = r[0] * x + r[1] * y + r[2] * z + r[9]
                    py = r[3] * x + r[4] * y + r[5] * z + r[10]
                    pz = r[6] * x + r[7] * y + r[8] * z + r[11]
                    for k in range(SIDE):
                        at = (i * SIDE + j) * SIDE + k
                        depth_here = pz + r[8] * voxel * k
                        if depth_here <= 0.0:
                            continue
                        u = lens[0] * (px + r[2] * voxel * k) / depth_here + lens[2]
                        v = lens[1] * (py + r[5] * voxel * k) / depth_here + lens[3]
                        if not (u >= 0.0 and v >= 0.0 and u < width and v < height):
                            continue
                        pixel = starts[view] + np.int64(v) * width + np.int64(u)
                        surface = depths[pixel]
                        weight = weights[pixel]
                        if not surface > f32(0.0) or weight == f32(0.0):
                            continue
                        distance = f32((np.float64(surface) - depth_here) / reach)
                        if abs(distance) > one:
                            continue
                        squares[at] += weight * distance * distance
                        mean[at] += weight * distance
                        whole[at] += weight
        for at in range(SIDE * SIDE * SIDE):
            if whole[at] > f32(0.0):
                mean[at] /= whole[at]
                squares[at] /= whole[at]
