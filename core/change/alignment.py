"""The second twin's world brought into the first's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..errors import NoOverlap
from ..evaluation.poses import Similarity
from ..progress import Progress
from .evidence import Array
from .matching import Matches, matches_between
from .motion import rotation_of
from .settings import ALIGNMENT
from .surface import Surface

#: Of twins whose cameras were given in one world.
SAME = Similarity(1.0, np.eye(3), np.zeros(3), 3)
#: Attributes of a camera.
_POSE, _LENS = ("rotation", "translation"), ("fx", "fy", "cx", "cy")
#: Px that stand for a point behind a camera.
_FAR = 1e4


def inverse(similarity: Similarity) -> Similarity:
    """The way back."""
    scale, rotation = 1.0 / similarity.scale, similarity.rotation.T
    return Similarity(scale, rotation, -scale * rotation @ similarity.translation, similarity.rank)


def composed(outer: Similarity, inner: Similarity) -> Similarity:
    """First `inner`, then `outer`."""
    rotation = outer.rotation @ inner.rotation
    return Similarity(outer.scale * inner.scale, rotation, outer.points(inner.translation), inner.rank)


def matched_worlds(first: Surface, second: Surface, threads: int, progress: Progress) -> tuple[Similarity, int]:
    """From the second world into the first, and how many matches agree on it.

    Raises:
        NoOverlap: too few do. CameraError: no features could be found. Cancelled: the user asked to stop.
    """
    return agreed_world(matches_between(first.twin, second.twin, threads, progress))


def agreed_world(found: Matches) -> tuple[Similarity, int]:
    """As `matched_worlds`, of matches."""
    world = _drawn(found)
    if world is not None:
        world = _fitted(found, world, np.flatnonzero(_off(found, world) < ALIGNMENT.first_reach))
        agreeing = np.flatnonzero(_off(found, world) < ALIGNMENT.reach)
        if len(agreeing) >= ALIGNMENT.matches:
            return _fitted(found, world, agreeing), len(agreeing)
    raise NoOverlap(
        f"The twins' worlds cannot be aligned: of {found.photo.shape[1]} matches between their photos too few agree",
        "Give twins of one object, photographed from alike sides, or cameras of both in one world (--cameras)",
    )


def _drawn(found: Matches) -> Similarity | None:
    """The similarity of three matches that most others agree with (Fischler and Bolles 1981)."""
    count = found.photo.shape[1]
    if count < ALIGNMENT.matches:
        return None
    generator = np.random.default_rng(0)
    judged = _part(found, generator.permutation(count)[: ALIGNMENT.judges])
    best, agreeing = None, 0
    for _ in range(ALIGNMENT.draws):
        three = generator.choice(count, 3, replace=False)
        world = _from_points(found.points[1, three], found.points[0, three])
        if world is None:
            continue
        fits = int((_off(judged, world) < ALIGNMENT.first_reach).sum())
        if fits > agreeing:
            best, agreeing = world, fits
    return best


def _part(found: Matches, which: NDArray[np.int64]) -> Matches:
    return Matches(found.cameras, found.photo[:, which], found.at[:, which], found.points[:, which])


def _from_points(source: Array, target: Array) -> Similarity | None:
    """The similarity that brings points nearest to others (Umeyama 1991); None where they are one point."""
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    away, off = source - middle, target - goal
    spread = float((away**2).sum())
    if spread <= 0.0 or not (off**2).sum() > 0.0:
        return None
    u, sizes, vt = np.linalg.svd(off.T @ away)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation, scale = (u * signs) @ vt, float((sizes * signs).sum()) / spread
    return Similarity(scale, rotation, goal - scale * rotation @ middle, 3) if scale > 0.0 else None


def _off(found: Matches, world: Similarity) -> Array:
    """[M] px that matches lie off, in the worse of both photos."""
    ways = _ways(found, world)
    return np.asarray(np.linalg.norm(ways, axis=2).max(axis=0))


def _ways(found: Matches, world: Similarity) -> Array:
    """[2, M, 2] px between each feature and where the other photo's lies, in both photos."""
    back = inverse(world)
    placed = world.points(found.points[1]), back.points(found.points[0])
    ways = []
    for cameras, photo, at, points in zip(found.cameras, found.photo, found.at, placed, strict=True):
        rotation, translation = (np.stack([getattr(c, part) for c in cameras])[photo] for part in _POSE)
        x, y, z = (np.einsum("mij,mj->mi", rotation, points) + translation).T
        fx, fy, cx, cy = (np.array([getattr(c, part) for c in cameras])[photo] for part in _LENS)
        z = np.where(z > 0, z, np.nan)
        seen = np.stack([fx * x / z + cx, fy * y / z + cy], axis=1)
        ways.append(np.nan_to_num(seen - at, nan=_FAR, posinf=_FAR, neginf=-_FAR).clip(-_FAR, _FAR))
    return np.stack(ways)


def _fitted(found: Matches, world: Similarity, which: NDArray[np.int64]) -> Similarity:
    """The similarity that matches lie least off with, in both photos; outliers hardly count."""
    part, middle = _part(found, which), found.points[1, which].mean(axis=0)
    size = float(np.sqrt(((found.points[1, which] - middle) ** 2).sum(axis=1).mean())) + 1e-30
    answer = least_squares(
        lambda values: _ways(part, _stepped(world, values, middle, size)).ravel(),
        np.zeros(7),
        loss="cauchy",
        f_scale=ALIGNMENT.reach / 3.0,
        x_scale=0.01,
    )
    return _stepped(world, answer.x, middle, size)


def _stepped(world: Similarity, values: Array, middle: Array, size: float) -> Similarity:
    """Shifted (in shares of `size`), turned (radians) and scaled (logarithm) about a point of the second world."""
    scale, rotation = float(np.exp(values[6])), rotation_of(values[3:6])
    step = Similarity(scale, rotation, middle + values[:3] * size - scale * rotation @ middle, 3)
    return composed(world, step)
