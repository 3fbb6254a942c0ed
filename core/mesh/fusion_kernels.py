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
    around, zero = 0.75 * voxel, np.int64(0)
    a0 = b0 = c0 = a1 = b1 = c1 = np.int64(-1)
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
                along0 = pose[0] * p0 + pose[3] * p1 + pose[6] * p2 - low[0]
                along1 = pose[1] * p0 + pose[4] * p1 + pose[7] * p2 - low[1]
                along2 = pose[2] * p0 + pose[5] * p1 + pose[8] * p2 - low[2]
                # blocks that begin within half a voxel, too: a cell of theirs may hold this surface
                i0, i1 = np.int64(np.floor((along0 - around) / side)), np.int64(np.floor((along0 + around) / side))
                j0, j1 = np.int64(np.floor((along1 - around) / side)), np.int64(np.floor((along1 + around) / side))
                k0, k1 = np.int64(np.floor((along2 - around) / side)), np.int64(np.floor((along2 + around) / side))
                if i0 == a0 and j0 == b0 and k0 == c0 and i1 == a1 and j1 == b1 and k1 == c1:
                    continue  # (as just before)
                a0, b0, c0, a1, b1, c1 = i0, j0, k0, i1, j1, k1
                for i in range(max(i0, zero), min(i1 + 1, marked.shape[0])):
                    for j in range(max(j0, zero), min(j1 + 1, marked.shape[1])):
                        for k in range(max(k0, zero), min(k1 + 1, marked.shape[2])):
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
    deep, pixel = np.empty(SIDE**3), np.empty(SIDE**3, np.int64)
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
            height, width, first = sizes[view, 0], sizes[view, 1], starts[view]
            mx, my, mz = x0 + half, y0 + half, z0 + half
            cz = r[6] * mx + r[7] * my + r[8] * mz + r[11]
            if cz <= radius:
                continue
            u = lens[0] * (r[0] * mx + r[1] * my + r[2] * mz + r[9]) / cz + lens[2]
            v = lens[1] * (r[3] * mx + r[4] * my + r[5] * mz + r[10]) / cz + lens[3]
            wide = 2.0 * max(lens[0], lens[1]) * radius / (cz - radius)
            if u < -wide or v < -wide or u > width + wide or v > height + wide:
                continue
            # (two loops, because the first one runs in vector registers)
            for line in range(SIDE * SIDE):
                x, y = x0 + (line // SIDE) * voxel, y0 + (line % SIDE) * voxel
                px = r[0] * x + r[1] * y + r[2] * z0 + r[9]
                py = r[3] * x + r[4] * y + r[5] * z0 + r[10]
                pz = r[6] * x + r[7] * y + r[8] * z0 + r[11]
                away, places = deep[line * SIDE : (line + 1) * SIDE], pixel[line * SIDE : (line + 1) * SIDE]
                for k in range(SIDE):
                    depth_here = pz + r[8] * voxel * k
                    u = lens[0] * (px + r[2] * voxel * k) / depth_here + lens[2]
                    v = lens[1] * (py + r[5] * voxel * k) / depth_here + lens[3]
                    shown = (depth_here > 0.0) & (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
                    away[k] = depth_here
                    places[k] = first + np.int64(v) * width + np.int64(u) if shown else np.int64(-1)
            for voxel_at in range(SIDE * SIDE * SIDE):
                place = pixel[voxel_at]
                shown = place >= 0
                place = place if shown else np.int64(0)
                surface, weight = depths[place], weights[place]
                distance = f32((np.float64(surface) - deep[voxel_at]) / reach)
                near = shown & (surface > f32(0.0)) & (abs(distance) <= one)
                weight = weight if near else f32(0.0)
                distance = distance if near else f32(0.0)
                squares[voxel_at] += weight * distance * distance
                mean[voxel_at] += weight * distance
                whole[voxel_at] += weight
        for at in range(SIDE * SIDE * SIDE):
            if whole[at] > f32(0.0):
                mean[at] /= whole[at]
                squares[at] /= whole[at]
