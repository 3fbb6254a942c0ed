"""From what photos say to motions with covariances: of places, of neighbourhoods, of the whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array

from ..camera import Camera
from .evidence import Array, Evidence, Places
from .settings import ALIGNMENT, EVIDENCE

#: Of the median of chi squared with three degrees of freedom.
_MEDIAN = 2.366


@dataclass(frozen=True)
class Motion:
    """Of each place.

    Attributes:
        by: [N, 3] px-equivalents; covariance: [N, 3, 3]; seen: [N] photos that see it.
    """

    by: Array = field(repr=False)
    covariance: Array = field(repr=False)
    seen: NDArray[np.int64] = field(repr=False)

    @property
    def surprise(self) -> Array:
        """[N] squared length of the motion in its own standard deviations."""
        return np.asarray(np.einsum("ni,ni->n", self.by, np.linalg.solve(self.covariance, self.by[..., None])[..., 0]))

    @property
    def size(self) -> Array:
        """[N] px-equivalents."""
        return np.asarray(np.linalg.norm(self.by, axis=1))


def solved(found: Evidence) -> Motion:
    """The motions that explain the photos best; each photo is one witness."""
    by, influence = _solutions(found.matrices.astype(np.float64), found.moments.astype(np.float64))
    return Motion(by, _scatter(influence, found.seen), found.seen)


def _solutions(matrices: Array, moments: Array) -> tuple[Array, Array]:
    """[N, k] solutions of [P, N, k, k] and [P, N, k], and [P, N, k] by how much each photo draws them its way."""
    whole = matrices.sum(axis=0)
    trace = np.trace(whole, axis1=1, axis2=2)
    inverse = np.linalg.inv(whole + (1e-6 * trace + 1e-9)[:, None, None] * np.eye(whole.shape[-1]))
    by = np.einsum("nij,nj->ni", inverse, moments.sum(axis=0))
    rest = moments - np.einsum("pnij,nj->pni", matrices, by)
    return by, np.einsum("nij,pnj->pni", inverse, rest)


def _scatter(influence: Array, seen: NDArray[np.int64]) -> Array:
    """[N, k, k] covariance of solutions: how much the photos disagree."""
    freedom = seen / np.maximum(seen - influence.shape[-1], 1)
    return np.asarray(freedom[:, None, None] * np.einsum("pni,pnj->nij", influence, influence))


def between(own: Evidence, other: Evidence) -> Motion:
    """What the other photos say, less what the twin's own say of it: that is what the twin has wrong.

    Rows of both go together: where cameras stand alike, what the twin has wrong shows alike, and is no scatter.
    """
    by, influence, seen = _difference(own, other)
    return Motion(by, _scatter(influence, seen) + EVIDENCE.floor**2 * np.eye(3), seen)


def _difference(own: Evidence, other: Evidence) -> tuple[Array, Array, NDArray[np.int64]]:
    """[N, 3] motions, [P, N, 3] by how much each photo draws them its way, [N] photos that see a place."""
    parts = [_solutions(e.matrices.astype(np.float64), e.moments.astype(np.float64)) for e in (own, other)]
    return parts[1][0] - parts[0][0], parts[1][1] - parts[0][1], np.minimum(own.seen, other.seen)


def paired(
    own: Evidence, other: Evidence, cameras: tuple[Sequence[Camera], Sequence[Camera]], places: Places
) -> tuple[Evidence, Evidence]:
    """Both with as many rows, those of cameras that stand alike beside one another; zeros where one has none."""
    middle = np.median(places.at, axis=0)
    towards = [np.stack([_towards(camera, middle) for camera in some]) for some in cameras]
    first, second = linear_sum_assignment(np.linalg.norm(towards[0][:, None] - towards[1][None], axis=2))
    rest = [np.setdiff1d(np.arange(len(t)), used) for t, used in zip(towards, (first, second), strict=True)]
    none = [np.full(len(rest[1]), -1), np.full(len(rest[0]), -1)]
    order = np.concatenate([first, rest[0], none[0]]), np.concatenate([second, none[1], rest[1]])
    return own.rows(order[0]), other.rows(order[1])


def _towards(camera: Camera, middle: Array) -> Array:
    """[6] where a camera stands, seen from the middle and at its distance, and where it looks."""
    off = camera.centre - middle
    return np.concatenate([off / np.linalg.norm(off), camera.rotation[2]])


def pooled(found: Evidence, members: csr_array) -> Evidence:
    """About neighbourhoods as if each moved as one.

    Args:
        members: [M, N] 1 where a place belongs to a neighbourhood.
    """
    photos, count = found.energies.shape
    parts = [
        np.stack([(members @ part.reshape(count, -1)) for part in values]).reshape(photos, members.shape[0], *shape)
        for values, shape in ((found.matrices, (3, 3)), (found.moments, (3,)), (found.energies, ()))
    ]
    counted = np.stack([members @ one.astype(np.float32) for one in found.sees])
    return Evidence(parts[0], parts[1], parts[2] / np.maximum(counted, 1), found.gains)


@dataclass(frozen=True)
class CommonMotion:
    """A small similarity that a whole surface has moved by: 3 of translation, 3 of rotation, 1 of scale.

    Attributes:
        values: [7] px-equivalents in the middle, at the distance `reach` from it for rotation and scale.
        covariance: [7, 7]; jacobian: [N, 3, 7] px-equivalents at each place.
        middle: [3], reach: world units; pixel: usual size of a px-equivalent, world units.
    """

    values: Array
    covariance: Array = field(repr=False)
    jacobian: Array = field(repr=False)
    middle: Array
    reach: float
    pixel: float

    @property
    def by(self) -> Array:
        """[N, 3] px-equivalents."""
        return np.asarray(self.jacobian @ self.values)

    def spread(self, members: csr_array | None = None) -> Array:
        """[N, 3, 3] covariance of it at places, or in the mean of neighbourhoods."""
        jacobian = self.jacobian
        if members is not None:
            sums = (members @ jacobian.reshape(len(jacobian), -1)).reshape(-1, 3, 7)
            jacobian = sums / np.maximum(members.sum(axis=1), 1)[:, None, None]
        return np.asarray(jacobian @ self.covariance @ jacobian.transpose(0, 2, 1))

    def similarity(self) -> tuple[float, Array, Array]:
        """Scale, rotation [3, 3] and translation [3] by which places of the world have moved."""
        turn = self.values[3:6] * self.pixel / self.reach
        scale = 1.0 + float(self.values[6]) * self.pixel / self.reach
        rotation = rotation_of(turn)
        shift = self.values[:3] * self.pixel
        return scale, rotation, self.middle + shift - scale * rotation @ self.middle


def rotation_of(turn: Array) -> Array:
    """[3, 3] of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def common_motion(
    own: Evidence, other: Evidence, places: Places, still: NDArray[np.bool_] | None = None
) -> CommonMotion:
    """What the unchanged majority says of one motion of the whole; places that say otherwise hardly count.

    Args:
        still: [N] places that have not moved, as far as is known; None: any may have.
    """
    held = enough(own, other) if still is None else still
    middle, jacobian, reach, pixel = _jacobian(places, held)
    by, influence, seen = _difference(own, other)
    single = _scatter(influence, seen) + EVIDENCE.floor**2 * np.eye(3)
    sure = np.linalg.inv(single) @ jacobian
    values, gain = np.zeros(7), np.zeros((7, len(by), 3))
    for _ in range(ALIGNMENT.reweighted):
        # From no motion on: what has changed stands out from what has not, before it may draw the whole its way.
        rest = Motion(by - jacobian @ values, single, seen).surprise
        usual = float(np.median(rest[held])) / _MEDIAN + 1e-12 if held.any() else 1.0
        weighted = sure * (held / (1.0 + rest / (3.0 * usual)) ** 2)[:, None, None]
        whole = np.einsum("nia,nib->ab", weighted, jacobian)
        gain = np.einsum("ab,nib->ani", np.linalg.inv(whole + 1e-9 * np.trace(whole) * np.eye(7)), weighted)
        values = np.einsum("ani,ni->a", gain, by)
    drawn = np.einsum("ani,pni->pa", gain, influence)
    photos = np.array([int((influence != 0).any(axis=(1, 2)).sum())])
    covariance = _scatter(drawn[:, None], photos)[0]
    return CommonMotion(values, covariance, jacobian, middle, reach, pixel)


def enough(own: Evidence, other: Evidence) -> NDArray[np.bool_]:
    """[N] places that enough photos of both see."""
    return np.asarray((own.seen >= EVIDENCE.photos) & (other.seen >= EVIDENCE.photos))


def _jacobian(places: Places, held: NDArray[np.bool_]) -> tuple[Array, Array, float, float]:
    at = places.at[held] if held.any() else places.at
    middle = np.median(at, axis=0)
    reach = float(np.sqrt(((at - middle) ** 2).sum(axis=1).mean())) + 1e-30
    pixel = float(np.median(places.pixel))
    x, y, z = ((places.at - middle) / reach).T
    zero = np.zeros_like(x)
    turned = np.stack([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    shifted = np.tile(np.eye(3), (len(x), 1, 1))
    grown = np.stack([x, y, z], axis=1)[:, :, None]
    whole = np.concatenate([shifted, turned, grown], axis=2)
    return middle, whole * (pixel / places.pixel)[:, None, None], reach, pixel
