"""How far away triangles are in each px of a picture. Knows no Blender."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera

Floats = NDArray[np.float64]

#: Px of triangles' boxes that are looked at together: what that takes of memory, some 100 MB.
_AT_ONCE = 2**20
#: The smallest boxes, and how much larger the next ones are: triangles are sorted by their boxes' longer side, px.
_SMALLEST, _LARGER = 4, 4


def triangle_depths(corners: Floats, camera: Camera, near: float) -> Floats:
    """[H, W] depth of the nearest triangle at the middle of each px, infinite where there is none.

    Args:
        corners: [T, 3, 3] in the camera's axes (x right, y down, z forward).
        near: what lies nearer is cut off.
    """
    height, width = camera.height, camera.width
    nearest = np.zeros(height * width)  # (inverse depths, which are linear in the frame)
    corners = _cut_off(corners, near)
    inverse = 1.0 / corners[..., 2]
    places = corners[..., :2] * inverse[..., None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    limit = np.array([width, height])
    first = np.clip(np.ceil(places.min(axis=1) - 0.5), 0, limit).astype(np.int64)
    last = np.clip(np.floor(places.max(axis=1) - 0.5), -1, limit - 1).astype(np.int64)
    sides = (last - first).max(axis=1) + 1
    seen = (last >= first).all(axis=1)
    least, most = 0, _SMALLEST
    while least < sides.max(initial=0):
        group = np.flatnonzero(seen & (sides > least) & (sides <= most))
        chunk = max(1, _AT_ONCE // most**2)
        for start in range(0, len(group), chunk):
            part = group[start : start + chunk]
            _fill(nearest, places[part], inverse[part], first[part], last[part], most, width)
        least, most = most, most * _LARGER
    with np.errstate(divide="ignore"):
        return (1.0 / nearest).reshape(height, width)


def _fill(
    nearest: Floats,
    places: Floats,
    inverse: Floats,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    side: int,
    width: int,
) -> None:
    """Puts triangles [T, 3, 2] px with inverse depths [T, 3] into `nearest` [H * W]; boxes are at most `side` wide."""
    side = min(side, int((last - first).max()) + 1)
    rows, columns = (grid.reshape(-1) for grid in np.mgrid[:side, :side])
    x, y = first[:, :1] + columns, first[:, 1:] + rows  # [T, side * side]
    a, b, c = (places[:, k, :, None] for k in range(3))
    px, py = x + 0.5, y + 0.5
    area = _twice(a, b, c[:, 0], c[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = [_twice(b, c, px, py) / area, _twice(c, a, px, py) / area, _twice(a, b, px, py) / area]
    inside = (x <= last[:, :1]) & (y <= last[:, 1:])
    for share in shares:
        inside &= share >= 0.0  # (false where there is no area)
    depth = np.einsum("ktp,tk->tp", np.stack(shares), inverse)
    np.maximum.at(nearest, (y * width + x)[inside], depth[inside])


def _twice(a: Floats, b: Floats, x: Floats, y: Floats) -> Floats:
    """Twice the area of the triangles of two corners [T, 2, 1] and points, with its sign."""
    result: Floats = (b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])
    return result


def _cut_off(corners: Floats, near: float) -> Floats:
    """Triangles without what is nearer: one where one corner is left, two where two are."""
    ahead = corners[..., 2] > near
    count = ahead.sum(axis=1)
    parts = [corners[count == 3]]
    for left in (1, 2):
        some = np.flatnonzero(count == left)
        # The corner that is alone on its side of the plane goes first.
        alone = np.argmax(ahead[some] == (left == 1), axis=1)
        turned = corners[some[:, None], (alone[:, None] + np.arange(3)) % 3]
        tip, second, third = (turned[:, k] for k in range(3))
        to_second, to_third = _crossing(tip, second, near), _crossing(tip, third, near)
        if left == 1:
            parts.append(np.stack([tip, to_second, to_third], axis=1))
        else:
            parts.append(np.stack([to_second, second, third], axis=1))
            parts.append(np.stack([to_second, third, to_third], axis=1))
    return np.concatenate(parts)


def _crossing(start: Floats, end: Floats, near: float) -> Floats:
    share = (near - start[:, 2:]) / (end[:, 2:] - start[:, 2:])
    crossing = start + share * (end - start)
    crossing[:, 2] = near
    return crossing
