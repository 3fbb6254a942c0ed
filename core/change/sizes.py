"""How large the motions of parts are, through the blur.

Blur mixes what has moved with what stands beside it, so that windows show less than all of a motion, and how far a part
reaches is not known. So parts are moved in the sharp render, by several supports, which is then degraded as the photos
were and asked in the same windows. How the motion falls off about each part says which support is likely; what shows of
a true motion there says how large its own is. Noise in the photos' gradients makes motions too small (errors in
variables, Fuller 1987), by as much as their squares exceed those of the render.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ..camera import Camera
from ..compiled import threads
from .evidence import About, Array, Evidence, Floats, Shown, jacobian, step_of
from .light import SlowLight, lit_alike
from .motion import Motion, between, pooled, solved
from .pair import Compared
from .parts import Indices, Part, local_motion
from .regions import neighbourhoods
from .settings import EVIDENCE, PARTS


@dataclass(frozen=True)
class Sized:
    """How large the motions of parts are.

    Attributes:
        by: [K, 3] px-equivalents, as windows show them, times what they lack; deviation: [K] along them.
    """

    by: Array = field(repr=False)
    deviation: Array = field(repr=False)


@dataclass(frozen=True)
class Fit:
    """What one support of each of K parts explains.

    Attributes:
        sizes: [K] px-equivalents; misfits: [K] mean square of what is left, in units of the photos' disagreement.
        variances: [K] of the sizes, px-equivalents squared, were the misfit 1 and all windows one.
    """

    sizes: Array = field(repr=False)
    misfits: Array = field(repr=False)
    variances: Array = field(repr=False)


def sized(found: Compared, parts: Sequence[Part]) -> Sized:
    """The motions of parts, all at once: one beside another shows in its windows, too."""
    members = _members([part.inner for part in parts], len(found.surface.places.at))
    shown = between(pooled(found.own, members), pooled(found.other, members))
    covariance = shown.covariance + found.common.spread(members)
    by = _ways(shown.by, covariance)
    size = np.maximum(np.linalg.norm(by, axis=1), 1e-12)
    way = by / size[:, None]
    moving, observed = _Moving(found), local_motion(found)
    fits = [moving.fit(parts, index, by, observed) for index in range(len(PARTS.shares))]
    noise = np.sqrt(np.einsum("ki,kij,kj->k", way, covariance, way)) / size
    likely, deviation = _likely(fits, np.array([part.windows for part in parts]), np.hypot(noise, PARTS.drawn))
    return Sized(way * likely[:, None], deviation)


def _likely(fits: Sequence[Fit], windows: Array, noise: Array) -> tuple[Array, Array]:
    """[K] sizes and their standard deviations: the mean over all supports, each as likely as it explains the photos.

    Args:
        windows: [K] about each part, beside one another; noise: [K] shares of the sizes.
    """
    sizes, misfits, variances = (
        np.stack([getattr(fit, name) for fit in fits]) for name in ("sizes", "misfits", "variances")
    )
    least = np.maximum(misfits.min(axis=0), 1e-12)  # (photos without noise may leave nothing)
    chances = np.exp(-0.5 * windows * (misfits - least) / least)
    chances /= chances.sum(axis=0)
    likely = (chances * sizes).sum(axis=0)
    reach = (chances * (sizes - likely) ** 2).sum(axis=0)
    shape = (chances * misfits * variances).sum(axis=0) / windows
    return likely, np.sqrt(reach + shape + (noise * likely) ** 2)


def _ways(by: Array, covariance: Array) -> Array:
    """[K, 3] motions, without what they have in the direction that is seen worst if that is no more than chance."""
    sizes, axes = np.linalg.eigh(covariance)
    worst = axes[:, :, 2]
    along = (by * worst).sum(axis=1)
    chance = abs(along) < PARTS.sure * np.sqrt(sizes[:, 2])
    return np.asarray(by - np.where(chance, along, 0.0)[:, None] * worst)


def _members(groups: Sequence[Indices], count: int) -> csr_array:
    """[K, N] 1 where a place belongs to a group."""
    rows = np.concatenate([np.full(len(group), index) for index, group in enumerate(groups)])
    columns = np.concatenate(list(groups))
    return csr_array((np.ones(len(rows), np.float32), (rows, columns)), shape=(len(groups), count))


@dataclass(frozen=True)
class _Photo:
    """What a photo would show, and by how much each of its px moves with the place that it shows.

    Attributes:
        shown, light: of the photo; nearest: [H + 2m, W + 2m] the place of each px, -1 for none.
        by_motion: [3, H + 2m, W + 2m, 3] of the sharp render, by px-equivalents along the world's axes.
    """

    shown: Shown
    light: SlowLight
    nearest: Indices = field(repr=False)
    by_motion: NDArray[np.float32] = field(repr=False)


def _slope(seen: Array, observed: Motion, about: Indices, way: Array, noise: Array) -> tuple[float, float, float]:
    """By how much a motion must be larger to be what is observed, the misfit then, and the slope's variance."""
    wanted, given = noise * (observed.by[about] @ way), seen[about] @ way
    weights = 1.0 / np.einsum("i,nij,j->n", way, observed.covariance[about], way)
    square = max(float((weights * given**2).sum()), 1e-12)
    share = float((weights * wanted * given).sum()) / square
    misfit = float((weights * (wanted - share * given) ** 2).mean())
    return share, misfit, len(about) / square


class _Moving:
    """Moves parts of a surface before some of the later photos."""

    def __init__(self, found: Compared) -> None:
        surface, photos = found.surface, found.beside.twin
        self.about = About(surface.twin, photos, surface.places, step_of(photos))
        self.tree = cKDTree(surface.places.at)
        self.near = neighbourhoods(surface.places, PARTS.near, found.tested.held)
        self.shown = pooled(found.other, self.near)
        kept = photos.kept[:: max(1, len(photos.kept) // PARTS.photos)]
        self.photos = [self._photo(self.about.shown(view, found.into.camera(view.camera))) for view in kept]

    def _photo(self, shown: Shown) -> _Photo:
        about, height = self.about, shown.sharp.shape[1]
        camera = shown.grid.camera.with_margin((height - shown.grid.camera.height) // 2)
        depth = about.depth(camera)
        local = _local(camera, depth)
        scale, pixel = about.surface.scale, float(np.median(about.places.pixel))
        world = (local - camera.translation) @ camera.rotation * scale.size + scale.origin
        there = np.isfinite(depth).ravel()
        away, place = self.tree.query(np.where(there[:, None], world, 0.0))
        nearest = np.where(there & (away < EVIDENCE.same * pixel), place, -1).reshape(depth.shape)
        gy, gx = np.gradient(shown.sharp.numpy(), axis=(1, 2))
        moves = np.nan_to_num(jacobian(local, camera)).reshape(*depth.shape, 2, 3) * (pixel / scale.size)
        by_motion = -(gx[..., None] * moves[None, :, :, 0] + gy[..., None] * moves[None, :, :, 1])
        _, light = lit_alike(shown.image, shown.grid.planes())
        return _Photo(shown, light, nearest, by_motion.astype(np.float32))

    def fit(self, parts: Sequence[Part], index: int, by: Array, observed: Motion) -> Fit:
        """The sizes that explain best what is observed about each part, if its support is the one at `index`.

        Args:
            by: [K, 3] px-equivalents, as windows show the motions.
        """
        shown = np.linalg.norm(by, axis=1)
        way = by / np.maximum(shown, 1e-12)[:, None]
        size = shown / PARTS.usual
        for _ in range(PARTS.rounds):
            everywhere = np.zeros((len(observed.by), 3))
            for part, one, length in zip(parts, way, size, strict=True):
                everywhere[part.supports[index]] = one * length
            said = pooled(self._evidence(everywhere), self.near)
            seen = solved(said).by
            fits = [
                _slope(seen, observed, part.about, one, self._noise(said, part.about, one))
                for part, one in zip(parts, way, strict=True)
            ]
            share, misfit, variance = np.array(fits).T
            tried, size = size, np.clip(share * size, PARTS.least * shown, shown / PARTS.lowest)
        return Fit(size, misfit, variance * tried**2)

    def _noise(self, without: Evidence, places: Indices, way: Array) -> Array:
        """[M] by how much noise makes motions too small: photos' gradients along a way hold it, these here do not."""
        whole, clean = (
            np.einsum("pnij,i,j->n", one.matrices[:, places], way, way) / np.maximum(one.seen[places], 1)
            for one in (self.shown, without)
        )
        return np.clip(whole / np.maximum(clean, 1e-30), 1.0, PARTS.noise)

    def _evidence(self, moved: Array) -> Evidence:
        """What photos would say if places had moved by [N, 3] px-equivalents."""
        changes = [_change(photo, moved) for photo in self.photos]
        with ThreadPoolExecutor(min(2, threads())) as pool:  # (means over windows run on one core each)
            found = list(pool.map(self._said, self.photos, changes))
        return Evidence(*(np.stack(part).astype(np.float32) for part in zip(*found, strict=True)))

    def _said(self, photo: _Photo, change: Floats) -> tuple[Floats, Floats, Floats, float]:
        return *self.about.said(photo.shown, photo.light.without(change), photo.light), photo.light.gain


def _change(photo: _Photo, moved: Array) -> Floats:
    """[3, H, W] by which a photo would change if places had moved by [N, 3] px-equivalents."""
    by = np.where(photo.nearest[..., None] >= 0, moved[photo.nearest], 0.0)
    change = torch.from_numpy((photo.by_motion * by[None]).sum(axis=-1)).float()
    with torch.no_grad():  # (small, as blur may act on light: what it makes of a change is its derivative)
        shown = photo.shown.degraded(photo.shown.sharp + PARTS.small * change).numpy()
    return np.asarray((shown - photo.shown.image) / PARTS.small)


def _local(camera: Camera, depth: NDArray[np.float32]) -> Array:
    """[H W, 3] what each px shows, in the camera's own axes."""
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)
    return np.asarray((rays * depth[..., None]).reshape(-1, 3))
