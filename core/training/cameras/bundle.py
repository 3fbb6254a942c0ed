"""Bundle adjustment: cameras and points moved to where the photos see the points, held where the photos are silent.

Gauss and Newton's steps, damped (Levenberg and Marquardt), the points eliminated by Schur's complement (Triggs et al.
2000). What the photos determine only weakly - a dome under flat ground, the focal length against the distance - would
run away on small errors: every camera is held to where it was, loosely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation

from ...camera import Camera
from ...numbers import BY_DEFINITION, number
from .pose_steps import twisted

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AdjustmentSettings:
    """Of the adjustment of cameras by what photos see in common."""

    camera_prior: float = number(
        3.0,
        "px",
        "by which a camera is expected to be off, along each of its axes and around them; smaller holds cameras"
        " nearer to where they were",
    )
    focal_prior: float = number(
        0.005,
        "share",
        "relative error that a focal length may have: it hides behind the distance, and runs away on blurred photos",
    )
    observations_per_fact: float = number(
        20.0, "count", "neighbouring observations err together: so many count as much as one that stands alone"
    )
    outlier: float = number(
        2.0, "typical errors", "observations that are off by more than this count little (Geman and McClure's weights)"
    )
    iterations: int = number(12, "count", "steps of an adjustment; half as many for one camera before fixed points")
    damping: float = number(
        1e-4, "share", "of the diagonal that is added at first (Levenberg and Marquardt)", BY_DEFINITION
    )


SETTINGS = AdjustmentSettings()
#: Of a prior that keeps cameras where they are.
_FIXED = 1e-4


@dataclass(frozen=True)
class Observations:
    """Points as photos see them.

    Attributes:
        camera, point: [K] which camera sees which point.
        position: [K, 2] px from the optical axis.
        error: [K] px, relative to each other.
    """

    camera: NDArray[np.int64]
    point: NDArray[np.int64]
    position: Floats
    error: Floats

    def __len__(self) -> int:
        return len(self.camera)


@dataclass(frozen=True)
class Adjusted:
    """What an adjustment found: cameras, points [M, 3], and the median px that observations are off."""

    cameras: list[Camera]
    points: Floats
    left: float


@dataclass
class _State:
    rotation: Floats
    translation: Floats
    points: Floats
    zoom: float


def adjusted(
    cameras: Sequence[Camera], points: Floats, seen: Observations, focal: bool, settings: AdjustmentSettings = SETTINGS
) -> Adjusted:
    """Cameras and points that explain the observations, and what is left of them.

    Args:
        cameras: one focal length for all; points: [M, 3], each seen by two cameras at least.
        focal: whether the shared focal length may change.

    Returns:
        Cameras and points still have the freedom of a similarity.
    """
    problem = _Problem(cameras, seen, focal, settings)
    state = problem.state(cameras, points)
    damping = settings.damping
    for _ in range(settings.iterations):
        weight = problem.weights(state)
        trial = problem.step(state, weight, damping)
        if problem.cost(trial, weight) < problem.cost(state, weight):
            state, damping = trial, max(damping / 10, 1e-8)
        else:
            damping *= 10
    found = [
        replace(c, rotation=r, translation=t, fx=c.fx * np.exp(state.zoom), fy=c.fy * np.exp(state.zoom))
        for c, r, t in zip(cameras, state.rotation, state.translation, strict=True)
    ]
    return Adjusted(found, state.points, float(np.median(np.linalg.norm(problem.residual(state)[0], axis=1))))


def contradiction(
    cameras: Sequence[Camera], points: Floats, seen: Observations, found: Adjusted, settings: AdjustmentSettings
) -> float:
    """How much better observations are explained by other cameras than by other points alone, over what chance does.

    Each of the six numbers of a camera takes one off the weighted squares where nothing is wrong with it and
    observations err as they are thought to, so that this is 1 there (or less, as `settings` hold cameras back).

    Args:
        found: what `adjusted` made of all this, with one focal length throughout.
    """
    problem = _Problem(cameras, seen, False, settings)
    moved, before = problem.state(found.cameras, found.points), problem.state(cameras, points)
    weight = problem.weights(moved)
    held = _Problem(cameras, seen, False, replace(settings, camera_prior=settings.camera_prior * _FIXED))
    for _ in range(settings.iterations // 4):  # (points alone are found at once)
        before = held.step(before, weight, settings.damping)
    gained = problem.cost(before, weight) - problem.cost(moved, weight)
    return gained / (6 * len(cameras))


class _Problem:
    def __init__(
        self, cameras: Sequence[Camera], seen: Observations, focal: bool, settings: AdjustmentSettings
    ) -> None:
        self.settings = settings
        self.seen, self.n, self.size = seen, len(cameras), 6 * len(cameras) + 1
        self.began = np.stack([c.rotation for c in cameras]), np.stack([c.translation for c in cameras])
        self.fx = np.array([c.fx for c in cameras])
        px = 1.0 / self.fx[:, None]
        # Along the view a camera moves twice as far for a px.
        pose = np.concatenate([px, px, 2 * px, px, px, px], axis=1).ravel()
        # Precisions of the prior that every camera is where it was.
        self.prior = 1.0 / np.append(pose * settings.camera_prior, settings.focal_prior if focal else 1e-9) ** 2

    def state(self, cameras: Sequence[Camera], points: Floats) -> _State:
        """Cameras and points as they are."""
        turned, placed = np.stack([c.rotation for c in cameras]), np.stack([c.translation for c in cameras])
        return _State(turned, placed, points.copy(), 0.0)

    def residual(self, state: _State) -> tuple[Floats, Floats, Floats]:
        """[K, 2] px, [K, 3] points before the cameras, [K] focal lengths."""
        at, which = self.seen.camera, self.seen.point
        local = np.einsum("kab,kb->ka", state.rotation[at], state.points[which]) + state.translation[at]
        length = self.fx[at] * np.exp(state.zoom)
        return self.seen.position - local[:, :2] / local[:, 2:] * length[:, None], local, length

    def weights(self, state: _State) -> Floats:
        """[K] of the squares, in units of the typical error."""
        off = np.linalg.norm(self.residual(state)[0], axis=1) / self.seen.error
        typical = max(1.4826 * float(np.median(off)), 1e-6)
        far = off / (self.settings.outlier * typical)
        return 1.0 / ((1.0 + far**2) * self.seen.error * typical) ** 2 / self.settings.observations_per_fact

    def drift(self, state: _State) -> Floats:
        """[6 n + 1] how far every camera is from where it began."""
        turn = state.rotation @ self.began[0].transpose(0, 2, 1)
        shift = state.translation - np.einsum("nab,nb->na", turn, self.began[1])
        each = np.concatenate([shift, Rotation.from_matrix(turn).as_rotvec()], axis=1)
        return np.append(each.ravel(), state.zoom)

    def cost(self, state: _State, weight: Floats) -> float:
        """Weighted squares of residuals and drift."""
        rest = self.residual(state)[0]
        return float((weight * (rest**2).sum(axis=1)).sum() + (self.prior * self.drift(state) ** 2).sum())

    def step(self, state: _State, weight: Floats, damping: float) -> _State:
        """One damped step of all."""
        rest, local, length = self.residual(state)
        at, which, k = self.seen.camera, self.seen.point, len(self.seen)
        by_local_point, by_camera = _derivatives(local, length)
        by_point = by_local_point @ state.rotation[at]
        root = np.sqrt(weight)[:, None]
        columns = np.concatenate([6 * at[:, None] + np.arange(6), np.full((k, 1), self.size - 1)], axis=1)
        rows = 2 * np.arange(k)[:, None] + np.arange(2)
        camera_side = _sparse(by_camera * root[..., None], rows, columns, (2 * k, self.size))
        point_side = _sparse(
            by_point * root[..., None], rows, 3 * which[:, None] + np.arange(3), (2 * k, 3 * len(state.points))
        )
        right = (rest * root).ravel()
        square = camera_side.T @ camera_side
        mixed = camera_side.T @ point_side
        block = np.zeros((len(state.points), 3, 3))
        np.add.at(block, which, np.einsum("k,kab,kac->kbc", weight, by_point, by_point))
        block += damping * block * np.eye(3) + 1e-9 * np.eye(3)
        count = len(block)
        inverse = sparse.bsr_matrix((np.linalg.inv(block), np.arange(count), np.arange(count + 1))).tocsr()
        through = mixed @ inverse
        point_gradient = point_side.T @ right
        matrix = (square - through @ mixed.T).toarray() + np.diag(self.prior)
        matrix += damping * np.diag(square.diagonal())
        vector = camera_side.T @ right - through @ point_gradient - self.prior * self.drift(state)
        move = np.linalg.solve(matrix, vector)
        points = inverse @ (point_gradient - mixed.T @ move)
        pose = move[:-1].reshape(self.n, 6)
        turn = Rotation.from_rotvec(pose[:, 3:]).as_matrix()
        return _State(
            turn @ state.rotation,
            np.einsum("nab,nb->na", turn, state.translation) + pose[:, :3],
            state.points + points.reshape(-1, 3),
            state.zoom + float(move[-1]),
        )


def aligned_camera(
    camera: Camera, points: Floats, position: Floats, error: Floats, settings: AdjustmentSettings = SETTINGS
) -> Camera:
    """One camera, where points [K, 3] that stay as they are are seen at `position` [K, 2]; see `adjusted`."""
    k = len(points)
    seen = Observations(np.zeros(k, np.int64), np.arange(k), position, error)
    problem = _Problem([camera], seen, False, settings)
    found = camera
    for _ in range(settings.iterations // 2):
        state = _State(found.rotation[None], found.translation[None], points, 0.0)
        weight = problem.weights(state)
        rest, local, length = problem.residual(state)
        by_camera = _derivatives(local, length)[1][:, :, :6]
        matrix = np.einsum("k,kab,kac->bc", weight, by_camera, by_camera) + np.diag(problem.prior[:6])
        vector = np.einsum("k,kab,ka->b", weight, by_camera, rest) - problem.prior[:6] * problem.drift(state)[:6]
        found = twisted(found, np.linalg.solve(matrix, vector))
    return found


def by_local(local: Floats, length: Floats) -> Floats:
    """[K, 2, 3] derivatives of positions in the points [K, 3] before the camera; length: [K] focal lengths in px."""
    x, y, z = local.T
    found = np.zeros((len(local), 2, 3))
    found[:, 0, 0] = found[:, 1, 1] = length / z
    found[:, 0, 2], found[:, 1, 2] = -length * x / z**2, -length * y / z**2
    return found


def turned_by(points: Floats) -> Floats:
    """[K, 3, 3] derivatives of points [K, 3] in a turn of the axes that they are given in: turn x point."""
    x, y, z = points.T
    cross = np.zeros((len(points), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 0] = z, -y, -z
    cross[:, 1, 2], cross[:, 2, 0], cross[:, 2, 1] = x, y, -x
    return cross


def _derivatives(local: Floats, length: Floats) -> tuple[Floats, Floats]:
    """Of positions [K, 2] in the points before the camera [K, 2, 3], and in the camera's twist and zoom [K, 2, 7]."""
    by_point = by_local(local, length)
    zoom = (local[:, :2] * (length / local[:, 2])[:, None])[..., None]
    return by_point, np.concatenate([by_point, by_point @ turned_by(local), zoom], axis=2)


def _sparse(
    values: Floats, rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]
) -> sparse.csr_matrix:
    """Blocks [K, 2, C] at rows [K, 2] and columns [K, C]."""
    k, _, c = values.shape
    i = np.repeat(rows[:, :, None], c, axis=2).ravel()
    j = np.repeat(columns[:, None, :], 2, axis=1).ravel()
    return sparse.csr_matrix((values.ravel(), (i, j)), shape=shape)
