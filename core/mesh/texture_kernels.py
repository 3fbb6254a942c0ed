"""Which face each texel is of, and what the views show there."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel

f32 = np.float32


@inlined
def weights_at(corners, x, y):  # type: ignore[no-untyped-def]
    """Barycentric weights of a place among a face's corners [3, 2]; of a face without area its middle's."""
    ax, ay = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    bx, by = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    px, py = x - corners[0, 0], y - corners[0, 1]
    area = ax * by - ay * bx
    if abs(area) < 1e-12:
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    second, third = (px * by - py * bx) / area, (ax * py - ay * px) / area
    return 1.0 - second - third, second, third


@kernel
def draw_faces(begin, end, corners, drawn, owner):  # type: ignore[no-untyped-def]
    """Gives texels to the faces that their middles lie in; of several the first one keeps it. One call for all faces.

    Args:
        corners: [M, 3, 2] float64, in texels from the upper left corner.
        drawn: [M] uint8 output, 1 where a face has a texel; owner: [S, S] int32 in and out, -1 where nobody has it.
    """
    side = owner.shape[0]
    for m in range(begin, end):
        c = corners[m]
        left = max(0, np.int64(np.floor(min(c[0, 0], c[1, 0], c[2, 0]) - 0.5)))
        right = min(side - 1, np.int64(np.ceil(max(c[0, 0], c[1, 0], c[2, 0]))))
        top = max(0, np.int64(np.floor(min(c[0, 1], c[1, 1], c[2, 1]) - 0.5)))
        bottom = min(side - 1, np.int64(np.ceil(max(c[0, 1], c[1, 1], c[2, 1]))))
        drawn[m] = 0
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                a, b, d = weights_at(c, column + 0.5, row + 0.5)
                if a >= -1e-9 and b >= -1e-9 and d >= -1e-9:
                    if owner[row, column] < 0:
                        owner[row, column] = m
                    if owner[row, column] == m:
                        drawn[m] = 1


@kernel
def draw_small_faces(begin, end, corners, drawn, owner):  # type: ignore[no-untyped-def]
    """Gives faces between the middles of texels the one that they are in, if nobody has it. One call for all faces."""
    side = owner.shape[0]
    for m in range(begin, end):
        if drawn[m]:
            continue
        x = (corners[m, 0, 0] + corners[m, 1, 0] + corners[m, 2, 0]) / 3.0
        y = (corners[m, 0, 1] + corners[m, 1, 1] + corners[m, 2, 1]) / 3.0
        row, column = min(side - 1, max(0, np.int64(y))), min(side - 1, max(0, np.int64(x)))
        if owner[row, column] < 0:
            owner[row, column] = m


@inlined
def look(point, normal, near, facing, depths, weights, images, starts, sizes, poses, lenses, found):  # type: ignore[no-untyped-def]
    """What each view shows of a place: colour and weight into `found` [V, 4]; returns how many views show it.

    The four px around are mixed, without those whose surface is another one: else colours run over the edges of what
    stands in front.
    """
    count = 0
    for view in range(len(starts)):
        r, lens = poses[view], lenses[view]
        x = r[0] * point[0] + r[1] * point[1] + r[2] * point[2] + r[9]
        y = r[3] * point[0] + r[4] * point[1] + r[5] * point[2] + r[10]
        z = r[6] * point[0] + r[7] * point[1] + r[8] * point[2] + r[11]
        if z <= 0.0:
            continue
        u, v = lens[0] * x / z + lens[2] - 0.5, lens[1] * y / z + lens[3] - 0.5
        height, width = sizes[view, 0], sizes[view, 1]
        if not (u >= -0.5 and v >= -0.5 and u < width - 0.5 and v < height - 0.5):
            continue
        nx = r[0] * normal[0] + r[1] * normal[1] + r[2] * normal[2]
        ny = r[3] * normal[0] + r[4] * normal[1] + r[5] * normal[2]
        nz = r[6] * normal[0] + r[7] * normal[1] + r[8] * normal[2]
        if -(nx * x + ny * y + nz * z) < facing * np.sqrt(x * x + y * y + z * z):
            continue
        column, row = np.int64(np.floor(u)), np.int64(np.floor(v))
        whole, red, green, blue = f32(0.0), f32(0.0), f32(0.0), f32(0.0)
        for tap in range(4):
            i, j = row + (tap >> 1), column + (tap & 1)
            if i < 0 or j < 0 or i >= height or j >= width:
                continue
            pixel = starts[view] + i * width + j
            if weights[pixel] <= f32(0.0) or abs(np.float64(depths[pixel]) - z) > near:
                continue
            share = f32((1.0 - abs(v - i)) * (1.0 - abs(u - j))) * weights[pixel]
            whole += share
            red += share * images[pixel, 0]
            green += share * images[pixel, 1]
            blue += share * images[pixel, 2]
        if whole > f32(0.0):
            found[count, 0], found[count, 1], found[count, 2] = red / whole, green / whole, blue / whole
            found[count, 3] = whole
            count += 1
    return count


@inlined
def robust_mean(found, count, spread, rounds, colour):  # type: ignore[no-untyped-def]
    """The mean of `count` colours with their weights, those far from it counting less (Cauchy), into `colour` [3]."""
    for turn in range(rounds + 1):
        whole, red, green, blue = f32(0.0), f32(0.0), f32(0.0), f32(0.0)
        for n in range(count):
            weight = found[n, 3]
            if turn > 0:
                a, b, c = found[n, 0] - colour[0], found[n, 1] - colour[1], found[n, 2] - colour[2]
                weight = weight / (f32(1.0) + (a * a + b * b + c * c) / (spread * spread))
            whole += weight
            red += weight * found[n, 0]
            green += weight * found[n, 1]
            blue += weight * found[n, 2]
        colour[0], colour[1], colour[2] = red / whole, green / whole, blue / whole


@kernel
def paint(  # type: ignore[no-untyped-def]
    begin,
    end,
    texels,
    owner,
    corners,
    places,
    normals,
    near,
    facing,
    depths,
    weights,
    images,
    starts,
    sizes,
    poses,
    lenses,
    spread,
    rounds,
    picture,
    seen,
):
    """Colours of texels `begin` to `end`.

    Args:
        texels: [T] int64 places in the flat picture; owner: [S, S]; corners: as of `draw_faces`.
        places, normals: [M, 3, 3] float64 of the faces' corners, world units.
        near: [A] how far from a view's surface a place is still on it, and facing: [A] the least cosine between normal
            and view, one attempt after the other until a view shows the place.
        depths, weights, images, starts, sizes, poses, lenses: as of `gather_colours`.
        spread: of colours about their mean, sRGB; rounds: of the robust mean.
        picture: [S * S, 3] float32 output; seen: [S * S] uint8 output, 1 where a view shows the texel.
    """
    side = owner.shape[0]
    found = np.empty((len(starts), 4), np.float32)
    point, normal, colour = np.empty(3), np.empty(3), np.empty(3, np.float32)
    for t in range(begin, end):
        texel = texels[t]
        row, column = texel // side, texel % side
        m = owner[row, column]
        a, b, c = weights_at(corners[m], column + 0.5, row + 0.5)
        a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)  # (a small face's texel may have its middle beside it)
        total = a + b + c
        for axis in range(3):
            point[axis] = (a * places[m, 0, axis] + b * places[m, 1, axis] + c * places[m, 2, axis]) / total
            normal[axis] = a * normals[m, 0, axis] + b * normals[m, 1, axis] + c * normals[m, 2, axis]
        length = max(1e-30, np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2))
        for axis in range(3):
            normal[axis] /= length
        count = 0
        for attempt in range(len(near)):
            count = look(
                point,
                normal,
                near[attempt],
                facing[attempt],
                depths,
                weights,
                images,
                starts,
                sizes,
                poses,
                lenses,
                found,
            )
            if count > 0:
                break
        if count > 0:
            robust_mean(found, count, spread, rounds, colour)
            picture[texel, 0], picture[texel, 1], picture[texel, 2] = colour[0], colour[1], colour[2]
            seen[texel] = 1
