"""Lucas-Kanade alignment of small patches (Baker & Matthews 2004, inverse compositional, affine)."""

from __future__ import annotations

import numpy as np

from ..compiled import inlined, kernel


@inlined
def _cubic(image, x, y):  # type: ignore[no-untyped-def]
    """Catmull-Rom sample of a [H, W] image; pixel centres at +0.5; the caller keeps 2 px away."""
    fx, fy = x - 0.5, y - 0.5
    ix, iy = int(np.floor(fx)), int(np.floor(fy))
    tx, ty = np.float32(fx - ix), np.float32(fy - iy)
    half, one = np.float32(0.5), np.float32(1.0)
    x0 = half * tx * (-one + tx * (np.float32(2.0) - tx))
    x1 = one + half * tx * tx * (np.float32(3.0) * tx - np.float32(5.0))
    x2 = half * tx * (one + tx * (np.float32(4.0) - np.float32(3.0) * tx))
    x3 = half * tx * tx * (tx - one)
    y0 = half * ty * (-one + ty * (np.float32(2.0) - ty))
    y1 = one + half * ty * ty * (np.float32(3.0) * ty - np.float32(5.0))
    y2 = half * ty * (one + ty * (np.float32(4.0) - np.float32(3.0) * ty))
    y3 = half * ty * ty * (ty - one)
    total = np.float32(0.0)
    for row in range(4):
        line = image[iy - 1 + row]
        value = x0 * line[ix - 1] + x1 * line[ix] + x2 * line[ix + 1] + x3 * line[ix + 2]
        total += value * (y0 if row == 0 else y1 if row == 1 else y2 if row == 2 else y3)
    return total


@inlined
def _solve6(a, b):  # type: ignore[no-untyped-def]
    """Cholesky in place of a [6, 6], b [6]; False if not positive definite."""
    for j in range(6):
        s = a[j, j]
        for k in range(j):
            s -= a[j, k] * a[j, k]
        if s <= 1e-12:
            return False
        a[j, j] = np.sqrt(s)
        for i in range(j + 1, 6):
            t = a[i, j]
            for k in range(j):
                t -= a[i, k] * a[j, k]
            a[i, j] = t / a[j, j]
    for i in range(6):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]
    return True


@inlined
def _read_template(image, cx, cy, radius, stride, template, weight, jacobian):  # type: ignore[no-untyped-def]
    """The reference patch: its samples without their mean, their weights, and its Jacobian.

    template, weight: [count]; jacobian: [count, 6] of the samples by the six parameters of the warp; all written.

    Returns:
        Sum of the weights, and weighted energy of the template (0 for a patch without detail).
    """
    count = len(template)
    span = radius * stride
    total = 0.0
    mean = 0.0
    n = 0
    for j in range(-radius, radius + 1):
        for i in range(-radius, radius + 1):
            ox, oy = i * stride, j * stride
            w = np.exp(-2.0 * (ox * ox + oy * oy) / ((span + stride) * (span + stride)))
            value = _cubic(image, cx + ox, cy + oy)
            gx = 0.5 * (_cubic(image, cx + ox + 1.0, cy + oy) - _cubic(image, cx + ox - 1.0, cy + oy))
            gy = 0.5 * (_cubic(image, cx + ox, cy + oy + 1.0) - _cubic(image, cx + ox, cy + oy - 1.0))
            template[n] = value
            weight[n] = w
            jacobian[n, 0], jacobian[n, 1], jacobian[n, 2] = gx * ox, gx * oy, gx
            jacobian[n, 3], jacobian[n, 4], jacobian[n, 5] = gy * ox, gy * oy, gy
            total += w
            mean += w * value
            n += 1
    mean /= total
    energy = 0.0
    for n in range(count):
        template[n] -= mean
        energy += weight[n] * template[n] * template[n]
    return total, energy


@kernel
def align(begin, end, images, sizes, pairs, points, warps, radius, stride, steps, reach, out):  # type: ignore[no-untyped-def]
    """Finds where each reference patch lies in another photo.

    images: [V, H, W] float32; sizes: [V, 2] int32 width, height
    pairs: [P, 2] int32 reference view, other view
    points: [P, 4] float64 x, y in the reference, x, y guessed in the other (px)
    warps: [P, 4] float64 row-major affine guess: offset in other = warp @ offset in reference
    radius, stride: patch of (2 radius + 1)^2 samples, stride px apart
    reach: largest move (px) from the guess that is believed
    out: [P, 4] float64 x, y, correlation (-1 if it failed), move in px

    The loops of a step stand in one body: as functions they come out of the compiler with their sums in another order
    (`core.compiled.FAST_MATH`), and cameras would differ in their last bits.
    """
    side = 2 * radius + 1
    count = side * side
    template = np.empty(count, np.float64)
    weight = np.empty(count, np.float64)
    jacobian = np.empty((count, 6), np.float64)
    sampled = np.empty(count, np.float64)
    hessian = np.empty((6, 6), np.float64)
    factor = np.empty((6, 6), np.float64)
    move = np.empty(6, np.float64)
    span = radius * stride
    for item in range(begin, end):
        out[item, 2] = -1.0
        ref, other = pairs[item, 0], pairs[item, 1]
        cx, cy = points[item, 0], points[item, 1]
        edge = span + 4.0
        if cx < edge or cy < edge or cx > sizes[ref, 0] - edge or cy > sizes[ref, 1] - edge:
            continue
        total, energy = _read_template(images[ref], cx, cy, radius, stride, template, weight, jacobian)
        if energy <= 1e-12:
            continue
        # The mean of the patch is free, so its gradient explains nothing: project it out.
        for p in range(6):
            average = 0.0
            for n in range(count):
                average += weight[n] * jacobian[n, p]
            average /= total
            for n in range(count):
                jacobian[n, p] -= average
        for p in range(6):
            for q in range(6):
                s = 0.0
                for n in range(count):
                    s += weight[n] * jacobian[n, p] * jacobian[n, q]
                hessian[p, q] = s
        a, b, c, d = warps[item, 0], warps[item, 1], warps[item, 2], warps[item, 3]
        x, y = points[item, 2], points[item, 3]
        image = images[other]
        width, height = sizes[other, 0], sizes[other, 1]
        correlation = -1.0
        for step in range(steps + 1):
            reach_x = (abs(a) + abs(b)) * span + 3.0
            reach_y = (abs(c) + abs(d)) * span + 3.0
            if not (reach_x < x < width - reach_x and reach_y < y < height - reach_y):
                correlation = -1.0
                break
            mean = 0.0
            n = 0
            for j in range(-radius, radius + 1):
                for i in range(-radius, radius + 1):
                    ox, oy = i * stride, j * stride
                    sampled[n] = _cubic(image, x + a * ox + b * oy, y + c * ox + d * oy)
                    mean += weight[n] * sampled[n]
                    n += 1
            mean /= total
            power = 0.0
            cross = 0.0
            for n in range(count):
                sampled[n] -= mean
                power += weight[n] * sampled[n] * sampled[n]
                cross += weight[n] * sampled[n] * template[n]
            if power <= 1e-12 or cross <= 0.0:
                correlation = -1.0
                break
            correlation = cross / np.sqrt(power * energy)
            if step == steps:
                break
            gain = cross / power
            for p in range(6):
                s = 0.0
                for n in range(count):
                    s += weight[n] * jacobian[n, p] * (gain * sampled[n] - template[n])
                move[p] = s
                for q in range(6):
                    factor[p, q] = hessian[p, q]
            if not _solve6(factor, move):
                correlation = -1.0
                break
            # W <- W o dW^-1
            da, db, dx = 1.0 + move[0], move[1], move[2]
            dc, dd, dy = move[3], 1.0 + move[4], move[5]
            det = da * dd - db * dc
            if det < 0.2 or det > 5.0:
                correlation = -1.0
                break
            ia, ib, ic, id_ = dd / det, -db / det, -dc / det, da / det
            tx, ty = -(ia * dx + ib * dy), -(ic * dx + id_ * dy)
            x, y = x + a * tx + b * ty, y + c * tx + d * ty
            a, b, c, d = a * ia + b * ic, a * ib + b * id_, c * ia + d * ic, c * ib + d * id_
            if abs(dx) + abs(dy) < 2e-3 and step > 1:
                # one more sample would change the correlation by nothing that matters
                break
        far = np.hypot(x - points[item, 2], y - points[item, 3])
        if correlation > 0.0 and far <= reach:
            out[item, 0], out[item, 1], out[item, 2], out[item, 3] = x, y, correlation, far
