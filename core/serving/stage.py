"""Twins as they stand in a scene, as one set of Gaussians.

A twin that stands alone stays as it is, and the camera is carried into its axes: whether it was moved, turned or
scaled, its picture is to the bit the one of the twin as it was made. Others are carried into the first one's axes,
centres, shapes and harmonics together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera import Camera
from ..cloud import GaussianCloud
from ..constants import LOG_SCALE_LIMIT
from ..formats.turning import moved, rotated_harmonics
from ..gaussians import Gaussians
from .messages import Floats, PlacedTwin, SharedTwin
from .shown_rows import POINTS, Matrix, logits, matrix_of, nearest_depth, shown_rows

#: Axes that differ from a turned and scaled system by less than this share count as one.
_ROUNDING = 1e-5


@dataclass(frozen=True)
class Similarity:
    """x becomes size * rotation @ x + place; the rotation is proper."""

    rotation: Matrix
    size: float
    place: Matrix

    def seen_by(self, camera: Camera) -> Camera:
        """The camera in the axes that are carried; what it sees there has the same place in its frame."""
        translation = (camera.rotation @ self.place + camera.translation) / self.size
        return camera.moved(camera.rotation @ self.rotation, translation)


@dataclass(frozen=True)
class Staged:
    """All Gaussians that a view may show, in units of their own.

    Attributes:
        gaussians: means are (x - origin) / size.
        origin, size: of those units, in the axes of `to_scene`.
        to_scene: from those axes to the scene's.
        points: [M, 3] float64 some of the means.
    """

    gaussians: Gaussians
    origin: Matrix
    size: float
    to_scene: Similarity
    points: Matrix

    def camera(self, camera: Camera) -> Camera:
        """A camera of the scene in the Gaussians' own axes and units."""
        own = self.to_scene.seen_by(camera)
        return own.moved(own.rotation, (own.rotation @ self.origin + own.translation) / self.size)

    @property
    def unit(self) -> float:
        """The scene's units per unit of the Gaussians."""
        return self.size * self.to_scene.size

    def near(self, camera: Camera) -> float | None:
        """Nearest depth that is drawn, for a camera in the own units; None where nothing lies before it."""
        return nearest_depth(self.points @ camera.rotation[2] + camera.translation[2])


class Stage:
    """The twins that were handed over, and the last sets of Gaussians that were made of them."""

    def __init__(self, device: str = "cpu") -> None:
        self._device = device
        self._twins: dict[str, GaussianCloud] = {}
        self._staged: dict[tuple[PlacedTwin, ...], Staged | None] = {}

    def put(self, twin: SharedTwin, planes: Sequence[Floats]) -> None:
        """Takes over a twin's Gaussians; the memory is free again afterwards."""
        positions, scales, rotations, base, *rest = planes
        with np.errstate(divide="ignore", invalid="ignore"):
            log_scales = np.clip(np.log(scales), -LOG_SCALE_LIMIT, LOG_SCALE_LIMIT)
        sh = np.stack([base[:, :3], *rest], axis=1)
        self._twins[twin.key] = GaussianCloud(positions.copy(), log_scales, rotations.copy(), logits(base[:, 3]), sh)

    def forget(self, key: str) -> None:
        """Drops a twin; no error if it is not there."""
        self._twins.pop(key, None)
        self._staged.clear()

    def missing(self, placed: Sequence[PlacedTwin]) -> tuple[str, ...]:
        """Keys of those that were not handed over."""
        return tuple(twin.key for twin in placed if twin.key not in self._twins)

    def staged(self, placed: Sequence[PlacedTwin]) -> Staged | None:
        """The Gaussians of all these twins; None where none is left to be seen."""
        there = [twin for twin in placed if twin.key in self._twins and np.isfinite(twin.matrix).all()]
        if not there:
            return None
        first = similarity(matrix_of(there[0].matrix))
        to_scene = first if first is not None else Similarity(np.eye(3), 1.0, np.zeros(3))
        back = np.linalg.inv(_whole(to_scene))
        relative = tuple(replace(twin, matrix=_rounded(back @ matrix_of(twin.matrix))) for twin in there)
        if relative not in self._staged:
            while len(self._staged) > 1:  # one for the window, one for the final picture
                self._staged.pop(next(iter(self._staged)))
            self._staged[relative] = self._assembled(relative)
        staged = self._staged[relative]
        return None if staged is None else replace(staged, to_scene=to_scene)

    def _assembled(self, relative: Sequence[PlacedTwin]) -> Staged | None:
        clouds = [cloud for twin in relative if len(cloud := shown(self._twins[twin.key], twin))]
        if not clouds:
            return None
        degrees = max(cloud.sh.shape[1] for cloud in clouds)
        padded = [np.pad(cloud.sh, ((0, 0), (0, degrees - cloud.sh.shape[1]), (0, 0))) for cloud in clouds]
        means = np.concatenate([cloud.means for cloud in clouds]).astype(np.float64)
        origin = np.median(means, axis=0)
        size = float(np.median(np.linalg.norm(means - origin, axis=1))) or 1.0
        means = (means - origin) / size
        cloud = GaussianCloud(
            means.astype(np.float32),
            np.concatenate([cloud.log_scales for cloud in clouds]) - np.float32(np.log(size)),
            np.concatenate([cloud.quaternions for cloud in clouds]),
            np.concatenate([cloud.opacity_logits for cloud in clouds]),
            np.concatenate(padded),
        )
        points = means[:: max(1, len(means) // POINTS)]
        identity = Similarity(np.eye(3), 1.0, np.zeros(3))
        return Staged(Gaussians.from_cloud(cloud, self._device), origin, size, identity, points)


def shown(cloud: GaussianCloud, twin: PlacedTwin) -> GaussianCloud:
    """What is shown of a twin, in the axes that its matrix leads to."""
    kept = shown_rows(cloud.means, cloud.opacity_logits, twin)
    if twin.size > 0 and twin.size != 1.0:
        cloud = replace(cloud, log_scales=cloud.log_scales + np.float32(np.log(twin.size)))
    if not kept.all():
        cloud = GaussianCloud(
            *(a[kept] for a in (cloud.means, cloud.log_scales, cloud.quaternions, cloud.opacity_logits, cloud.sh))
        )
    return carried(cloud, matrix_of(twin.matrix))


def carried(cloud: GaussianCloud, matrix: Matrix) -> GaussianCloud:
    """The Gaussians in other axes; `matrix` [4, 4] may shear and mirror."""
    if np.array_equal(matrix, np.eye(4)):
        return cloud
    even = similarity(matrix)
    if even is not None:
        return moved(cloud, even.rotation, even.size, even.place)
    return _sheared(cloud, matrix[:3, :3], matrix[:3, 3])


def similarity(matrix: Matrix) -> Similarity | None:
    """A matrix [4, 4] as a turn, an even scale and a way; None where it is more than that."""
    linear = matrix[:3, :3]
    volume = float(np.linalg.det(linear))
    if volume <= 0:
        return None
    size = volume ** (1 / 3)
    left, _, right = np.linalg.svd(linear)
    rotation = left @ right
    if np.abs(linear - size * rotation).max() > _ROUNDING * size:
        return None
    return Similarity(rotation, size, matrix[:3, 3].copy())


def _sheared(cloud: GaussianCloud, linear: Matrix, place: Matrix) -> GaussianCloud:
    """Sigma becomes L Sigma L', which is taken apart into axes and lengths anew; gloss turns with the nearest turn."""
    quaternions = cloud.quaternions.astype(np.float64)
    w, x, y, z = (quaternions / np.maximum(np.linalg.norm(quaternions, axis=1, keepdims=True), 1e-12)).T
    axes = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )
    spread = linear @ (axes * np.exp(cloud.log_scales.astype(np.float64))[:, None, :])
    left, lengths, _ = np.linalg.svd(spread)
    left[:, :, 2] *= np.linalg.det(left)[:, None]
    turn_left, _, turn_right = np.linalg.svd(linear)
    return GaussianCloud(
        (cloud.means.astype(np.float64) @ linear.T + place).astype(np.float32),
        np.log(np.maximum(lengths, np.exp(-LOG_SCALE_LIMIT))).astype(np.float32),
        _quaternions(left).astype(np.float32),
        cloud.opacity_logits,
        rotated_harmonics(cloud.sh, turn_left @ turn_right),
    )


def _quaternions(rotations: Matrix) -> Matrix:
    """[N, 4] w x y z of rotations [N, 3, 3]: the eigenvectors of Bar-Itzhack's matrices, exact for every angle."""
    r = rotations
    k = np.empty((len(r), 4, 4))
    k[:, 0, 0] = r[:, 0, 0] - r[:, 1, 1] - r[:, 2, 2]
    k[:, 1, 1] = r[:, 1, 1] - r[:, 0, 0] - r[:, 2, 2]
    k[:, 2, 2] = r[:, 2, 2] - r[:, 0, 0] - r[:, 1, 1]
    k[:, 3, 3] = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    for i, j, value in (
        (0, 1, r[:, 1, 0] + r[:, 0, 1]),
        (0, 2, r[:, 2, 0] + r[:, 0, 2]),
        (1, 2, r[:, 2, 1] + r[:, 1, 2]),
        (0, 3, r[:, 2, 1] - r[:, 1, 2]),
        (1, 3, r[:, 0, 2] - r[:, 2, 0]),
        (2, 3, r[:, 1, 0] - r[:, 0, 1]),
    ):
        k[:, i, j] = k[:, j, i] = value
    return np.linalg.eigh(k)[1][:, [3, 0, 1, 2], -1]


def _whole(similarity: Similarity) -> Matrix:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = similarity.size * similarity.rotation, similarity.place
    return matrix


def _rounded(matrix: Matrix) -> tuple[float, ...]:
    """The same 16 numbers; what is the identity but for rounding becomes it."""
    if np.abs(matrix - np.eye(4)).max() < _ROUNDING:
        matrix = np.eye(4)
    return tuple(float(value) for value in matrix.reshape(16))
