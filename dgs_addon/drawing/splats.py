"""Twins as the shader takes them: rows of texels, which splats are shown, in which order. Knows no Blender.

A row of texels (four float32) is a splat:

| texel | holds |
|---|---|
| 0 | centre, from its twin's origin; number of the twin |
| 1 | quaternion, w x y z |
| 2 | standard deviations; opacity |
| 3 | zeroth harmonics; 0 |

Further harmonics are rows of their own, packed without gaps. Rows of twins say how each stands before the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.constants import FAR_PLANE, HARMONICS_LIMIT, QUATERNION_MINIMUM_NORM
from ...core.serving.messages import Floats, PlacedTwin, SharedTwin
from ...core.serving.shown_rows import POINTS, Matrix, logits, matrix_of, nearest_depth, shown_rows

#: A twin's state as it was handed over.
Content = tuple[SharedTwin, bytes]


@dataclass(frozen=True)
class Splats:
    """The splats of some twins, one twin after the other.

    Attributes:
        texels: [N, 4, 4]; harmonics: [N, T, 4], T = 0 where all have one colour.
        coefficients: harmonics of a splat, K.
        positions: [N, 3] in the twins' own axes; opacity_logits: [N].
        starts: where each twin begins, and N.
        origins: [twins, 3] float64 in the twins' own axes.
        sound: [N] whether a splat has a shape, a direction and a colour.
    """

    texels: Floats
    harmonics: Floats
    coefficients: int
    positions: Floats
    opacity_logits: Floats
    starts: tuple[int, ...]
    origins: Matrix
    sound: NDArray[np.bool_]

    def part(self, number: int) -> slice:
        """The rows of a twin."""
        return slice(self.starts[number], self.starts[number + 1])


@dataclass(frozen=True)
class Standing:
    """How twins stand before a camera.

    Attributes:
        rows: [twins, 3, 4] from a twin's origin and axes to the camera's (x right, y down, z forward).
        turns: [twins, 3, 3] directions from the camera's axes to those of the twin's harmonics.
        sizes: [twins] factor on the size of all splats.
    """

    rows: Matrix
    turns: Matrix
    sizes: Matrix

    def texels(self) -> Floats:
        """[twins, 6, 4]: three of rows, three of turns; the first of these has the size behind it."""
        texels = np.zeros((len(self.rows), 6, 4), np.float32)
        texels[:, :3], texels[:, 3:, :3], texels[:, 3, 3] = self.rows, self.turns, self.sizes
        return texels


@dataclass(frozen=True)
class Order:
    """Splats that are drawn, far to near.

    Attributes:
        index: [M] rows of `Splats`.
        key: equal for equal orders: the splats, and how they stand.
    """

    index: NDArray[np.intp]
    key: tuple[object, object]


def splats_of(contents: Sequence[Content]) -> Splats:
    """What some twins hold, as texels."""
    planes = [twin.planes(memoryview(content)) for twin, content in contents]
    coefficients = max((twin.harmonics for twin, _ in contents), default=1)
    starts = np.cumsum([0, *(twin.count for twin, _ in contents)])
    texels = np.zeros((starts[-1], 4, 4), np.float32)
    rest = -(-3 * (coefficients - 1) // 4)
    harmonics = np.zeros((starts[-1], rest, 4), np.float32)
    positions, origins = np.empty((starts[-1], 3), np.float32), np.zeros((len(contents), 3))
    for number, (own, start, end) in enumerate(zip(planes, starts, starts[1:], strict=False)):
        finite = own[0][np.isfinite(own[0]).all(axis=1)]
        origins[number] = np.median(finite, axis=0) if len(finite) else 0.0
        part = texels[start:end]
        positions[start:end] = own[0]
        part[:, 0, :3], part[:, 0, 3] = own[0] - origins[number], number
        part[:, 1], part[:, 2, :3], part[:, 2, 3], part[:, 3, :3] = own[2], own[1], own[3][:, 3], own[3][:, :3]
        flat = harmonics[start:end].reshape(end - start, 4 * rest)
        for k, plane in enumerate(own[4:]):
            flat[:, 3 * k : 3 * k + 3] = plane
    return Splats(
        texels,
        harmonics,
        coefficients,
        positions,
        logits(texels[:, 2, 3]),
        tuple(int(start) for start in starts),
        origins,
        _sound(texels, harmonics),
    )


def kept_rows(splats: Splats, placed: Sequence[PlacedTwin]) -> NDArray[np.intp]:
    """Rows that are shown, in their order."""
    kept = splats.sound.copy()
    for number, twin in enumerate(placed):
        part = splats.part(number)
        kept[part] &= shown_rows(splats.positions[part], splats.opacity_logits[part], twin)
    return np.flatnonzero(kept)


def standing(splats: Splats, placed: Sequence[PlacedTwin], camera: Camera) -> Standing:
    """How twins stand before a camera of the scene."""
    rows, turns = np.zeros((len(placed), 3, 4)), np.zeros((len(placed), 3, 3))
    for number, twin in enumerate(placed):
        matrix = matrix_of(twin.matrix)
        linear = camera.rotation @ matrix[:3, :3]
        rows[number, :, :3] = linear
        rows[number, :, 3] = linear @ splats.origins[number] + camera.rotation @ matrix[:3, 3] + camera.translation
        left, _, right = np.linalg.svd(linear)
        turns[number] = (left @ right).T
    return Standing(rows, turns, np.array([twin.size for twin in placed], np.float64))


def far_to_near(splats: Splats, kept: NDArray[np.intp], rows: Matrix, key: tuple[object, object] = (0, 0)) -> Order:
    """Rows that lie before the camera, farthest first.

    Args:
        kept: rows that are shown; rows: of `Standing`.
    """
    depths = np.empty(len(splats.texels), np.float32)
    # From the first twin's middle on: a camera that stands far back has depths that float32 cannot tell apart.
    middle = rows[0, 2, 3] if len(rows) else 0.0
    for number, row in enumerate(rows[:, 2]):
        part = splats.part(number)
        depths[part] = splats.texels[part, 0, :3] @ row[:3].astype(np.float32) + np.float32(row[3] - middle)
    shown = depths[kept]
    near = nearest_depth(shown[:: max(1, len(shown) // POINTS)].astype(np.float64) + middle)
    if near is None:
        return Order(kept[:0], key)
    seen = (shown > near - middle) & (shown < FAR_PLANE - middle)
    kept, shown = (kept, shown) if seen.all() else (kept[seen], shown[seen])
    return Order(kept[np.argsort(-shown)], key)


def _sound(texels: Floats, harmonics: Floats) -> NDArray[np.bool_]:
    """Splats that the engine does not cull for what they are."""
    sound = np.isfinite(texels).all(axis=(1, 2)) & np.isfinite(harmonics).all(axis=(1, 2))
    with np.errstate(invalid="ignore", over="ignore"):
        sound &= np.linalg.norm(texels[:, 1], axis=1) >= QUATERNION_MINIMUM_NORM
        colours = np.square(texels[:, 3, :3]).sum(axis=1) + np.square(harmonics).sum(axis=(1, 2))
        return sound & (colours <= HARMONICS_LIMIT**2)
