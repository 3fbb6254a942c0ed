"""Plane sweep: how alike the views are if a px's surface lay at each of many depths."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel

#: The cost of a plane that too few views see, and of one at which photos show that nothing is there.
UNSEEN, BARRED = 2.0, 3.0
#: The value of a px that another view does not show: so large that the sum of a window gives it away.
OUTSIDE = np.float32(1e9)


@kernel
def window_statistics(begin, end, grey, counts, radius, least, mean, scale):  # type: ignore[no-untyped-def]
    """Of each row: mean of the window around every px, and 1 / the root of its sum of squared deviations.

    Args:
        grey: [H, W] float32; counts: [H, W] bool.
        least: standard deviation below which a window has no texture.
        mean, scale: [H, W] float32 output; scale is 0 where a window has no texture, or leaves the frame.
    """
    height, width = grey.shape
    samples = np.float32((2 * radius + 1) ** 2)
    for y in range(begin, end):
        for x in range(width):
            scale[y, x] = 0.0
            mean[y, x] = 0.0
            if y < radius or x < radius or y >= height - radius or x >= width - radius or not counts[y, x]:
                continue
            total = np.float32(0)
            for j in range(y - radius, y + radius + 1):
                for i in range(x - radius, x + radius + 1):
                    total += grey[j, i]
            middle = total / samples
            squares = np.float32(0)
            for j in range(y - radius, y + radius + 1):
                for i in range(x - radius, x + radius + 1):
                    squares += (grey[j, i] - middle) ** 2
            mean[y, x] = middle
            if squares > samples * least * least:
                scale[y, x] = np.float32(1.0) / np.sqrt(squares)


@inlined
def _sum_along(there, here, radius, plain, square, mixed):  # type: ignore[no-untyped-def]
    """Sums over windows of 2 radius + 1 px of a row: of its values, of their squares, of products with another row's.

    Three px at once and then two by two: the sums are read and written half as often as px by px.

    Args:
        there, here: [W] float32; plain, square, mixed: [W - 2 radius] float32 output.
    """
    inner = len(plain)
    a, b, c = there[:inner], there[1 : 1 + inner], there[2 : 2 + inner]
    p, q, r = here[:inner], here[1 : 1 + inner], here[2 : 2 + inner]
    for x in range(inner):
        plain[x] = a[x] + b[x] + c[x]
        square[x] = a[x] * a[x] + b[x] * b[x] + c[x] * c[x]
        mixed[x] = a[x] * p[x] + b[x] * q[x] + c[x] * r[x]
    for k in range(3, 2 * radius + 1, 2):
        a, b = there[k : k + inner], there[k + 1 : k + 1 + inner]
        p, q = here[k : k + inner], here[k + 1 : k + 1 + inner]
        for x in range(inner):
            plain[x] += a[x] + b[x]
            square[x] += a[x] * a[x] + b[x] * b[x]
            mixed[x] += a[x] * p[x] + b[x] * q[x]


@inlined
def _sum_down(rows, total):  # type: ignore[no-untyped-def]
    """The sum of an odd number of rows, 3 at least, as `_sum_along` takes px.

    Args:
        rows: [N, W] float32; total: [W] float32 output.
    """
    a, b, c = rows[0], rows[1], rows[2]
    for x in range(len(total)):
        total[x] = a[x] + b[x] + c[x]
    for k in range(3, rows.shape[0], 2):
        a, b = rows[k], rows[k + 1]
        for x in range(len(total)):
            total[x] += a[x] + b[x]


@kernel
def plane_costs(  # type: ignore[no-untyped-def]
    begin,
    end,
    grey,
    mean,
    scale,
    box,
    images,
    counts,
    sizes,
    others,
    turns,
    shifts,
    planes,
    around,
    radius,
    fewest,
    costs,
):
    """1 - correlation of the window around every px with the windows of other views, for a range of planes.

    The mean over the better half of the other views, two at most: where a view is occluded, the others decide (Kang et
    al. 2001). Where only one of them sees the window, that one decides, if one is enough.

    Args:
        grey, mean, scale: [H, W] of the reference view; box: [4] x0, y0, x1, y1, the part that is wanted.
        images: [V, h, w] float32; counts: [V, h, w] bool; sizes: [V, 2]; others: [N] indices of views.
        turns [N, 3, 3], shifts [N, 3]: px of view n, times depth = turns @ (u, v, 1) + shifts * inverse depth.
        planes: [D] inverse depths, as multiples of around: [H, W] float64 of the reference view; ones for planes that
            face it.
        radius: 1 at least; fewest: 1 or 2 other views that must see a window.
        costs: [D, H, W] float32 output; `UNSEEN` where fewer see the window.
    """
    x0, y0, x1, y1 = box[0], box[1], box[2], box[3]
    left, top = max(0, x0 - radius), max(0, y0 - radius)
    right, bottom = min(grey.shape[1], x1 + radius), min(grey.shape[0], y1 + radius)
    w, h = right - left, bottom - top
    samples = np.float32((2 * radius + 1) ** 2)
    inner = w - 2 * radius  # columns that have a whole window
    if inner <= 0:
        return
    sums = np.empty((3, h, inner), np.float32)
    first, second = np.empty(sums.shape[1:], np.float32), np.empty(sums.shape[1:], np.float32)
    across, along, value = np.empty(w, np.float32), np.empty(w, np.float32), np.empty(w, np.float32)
    total = np.empty((3, inner), np.float32)
    needed = max(1, others.shape[0] // 2)
    for d in range(begin, end):
        first[:, :] = -2.0
        second[:, :] = -2.0
        for n in range(others.shape[0]):
            image, valid = images[others[n]], counts[others[n]]
            wide, high = sizes[others[n], 0], sizes[others[n], 1]
            turn, shift = turns[n], shifts[n]
            bx, by, bz = shift[0] * planes[d], shift[1] * planes[d], shift[2] * planes[d]
            for y in range(h):
                v = y + top + 0.5
                rx, ry, rz = turn[0, 1] * v, turn[1, 1] * v, turn[2, 1] * v
                rx, ry, rz = rx + turn[0, 2], ry + turn[1, 2], rz + turn[2, 2]
                nearness = around[y + top, left:right]  # (slices begin at 0: loops over them run in vector registers)
                for x in range(w):
                    u = x + left + 0.5
                    near = nearness[x]
                    z = np.float32(turn[2, 0] * u + rz + bz * near)
                    # (px centres at +0.5 become whole numbers; behind the camera is outside of every frame)
                    inverse = np.float32(1.0) / z if z > 1e-12 else np.float32(-1e9)
                    across[x] = np.float32(turn[0, 0] * u + rx + bx * near) * inverse - np.float32(0.5)
                    along[x] = np.float32(turn[1, 0] * u + ry + by * near) * inverse - np.float32(0.5)
                for x in range(w):
                    value[x] = OUTSIDE
                    if across[x] >= 0 and along[x] >= 0 and across[x] < wide - 1 and along[x] < high - 1:
                        i, j = int(across[x]), int(along[x])
                        if valid[j, i]:
                            a, b = across[x] - np.float32(i), along[x] - np.float32(j)
                            upper = image[j, i] + a * (image[j, i + 1] - image[j, i])
                            lower = image[j + 1, i] + a * (image[j + 1, i + 1] - image[j + 1, i])
                            value[x] = upper + b * (lower - upper)
                plain, square, mixed = sums[0, y], sums[1, y], sums[2, y]
                _sum_along(value, grey[y + top, left:right], radius, plain, square, mixed)
            for y in range(radius, h - radius):
                for s in range(3):
                    _sum_down(sums[s, y - radius : y + radius + 1], total[s])
                row = slice(left + radius, left + radius + inner)
                middle, inverse_spread = mean[y + top, row], scale[y + top, row]
                best, next_best = first[y], second[y]
                for x in range(inner):
                    # float32: what is left of a flat window's variance is rounding
                    spread = max(total[1, x] - total[0, x] * total[0, x] / samples, np.float32(1e-5) * samples)
                    alike = (total[2, x] - total[0, x] * middle[x]) * inverse_spread[x] / np.sqrt(spread)
                    alike = alike if total[0, x] < 0.5 * OUTSIDE else np.float32(-2.0)
                    if needed > 1:
                        next_best[x] = max(next_best[x], min(best[x], alike))
                    best[x] = max(best[x], alike)
        for y in range(radius, h - radius):
            for x in range(inner):
                one, two = first[y, x], second[y, x]
                alike = one if needed == 1 or two <= -1.5 else np.float32(0.5) * (one + two)
                fine = one > -1.5 if fewest == 1 or needed == 1 else two > -1.5
                fine = fine and scale[y + top, x + left + radius] > 0
                costs[d, y + top, x + left + radius] = np.float32(1.0) - alike if fine else np.float32(UNSEEN)


@kernel
def best_planes(begin, end, costs, scale, apart, depth, cost, margin):  # type: ignore[no-untyped-def]
    """Row by row: the plane of least cost, between two planes; and by how much it beats every other minimum.

    Args:
        costs: [D, H, W] float32, at least `UNSEEN` where a plane is out of sight, at least `BARRED` where photos show
            that nothing is there; scale: [H, W], 0 where a px is not asked.
        apart: planes; nearer ones than this are no other minimum.
        depth: [H, W] float32 output, index of the plane with its fraction; -1 where there is none.
        cost, margin: [H, W] float32 output.
    """
    count, width = costs.shape[0], costs.shape[2]
    for y in range(begin, end):
        for x in range(width):
            depth[y, x] = -1.0
            cost[y, x] = 2.0
            margin[y, x] = 0.0
            if scale[y, x] == 0:
                continue
            best, least = -1, np.float32(UNSEEN)
            for d in range(count):
                if costs[d, y, x] < least:
                    best, least = d, costs[d, y, x]
            if best <= 0 or best >= count - 1:  # at an end of the range the minimum may lie beyond
                continue
            other = np.float32(UNSEEN)
            for d in range(count):
                if d < best - apart or d > best + apart:
                    other = min(other, costs[d, y, x])
            before, after = costs[best - 1, y, x], costs[best + 1, y, x]
            # Next to a plane that no other view sees the minimum may lie there; next to an empty one it does not.
            if UNSEEN <= before < BARRED or UNSEEN <= after < BARRED:
                continue
            bend = before + after - 2 * least
            between = before < UNSEEN and after < UNSEEN and bend > 0
            depth[y, x] = best + (np.float32(0.5) * (before - after) / bend if between else np.float32(0))
            cost[y, x] = least
            margin[y, x] = other - least
