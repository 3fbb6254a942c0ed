"""Parts of a region that have moved each by itself, and how large their motions are through the blur.

Gaps that are narrower than the blur do not part what moves: windows on both sides see it all. But the motion that they
show falls off between the parts, so that each is found by its peak. How large it is does not show by itself: blur
mixes what has moved with what stands beside it. So the parts are moved in the sharp render, which is then degraded as
the photos were and compared with the still one in the same windows: by what share of a true motion comes out there,
each part's own is too small. How far a part reaches between its peak and what stands still is not known, and shows in
the interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ..camera import Camera
from .evidence import About, Array, Evidence, Shown, jacobian, step_of
from .light import SlowLight, lit_alike
from .motion import Motion, between, pooled, solved
from .pair import Compared
from .regions import components, neighbourhoods
from .settings import EVIDENCE, PARTS

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """Places that have moved as one.

    Attributes:
        places: of the region, all that lie nearer to this part than to its others.
        supports: those that may have moved themselves: the likeliest, the fewest and the most.
        inner: of the likeliest, away from what has not moved: these are asked.
    """

    places: Indices
    supports: tuple[Indices, Indices, Indices]
    inner: Indices


def parted(found: Compared, places: Indices, whole: Motion) -> list[Part]:
    """The parts of a region [M] whose places together have moved by `whole` [1]; itself where it has one."""
    surface, held = found.surface, found.tested.held
    near = neighbourhoods(surface.places, PARTS.near, held)
    local = between(pooled(found.own, near), pooled(found.other, near))
    way = whole.by[0] / max(float(np.linalg.norm(whole.by[0])), 1e-12)
    along, sure = local.by @ way, np.sqrt(np.einsum("i,nij,j->n", way, local.covariance, way))
    peak = float(np.quantile(along[places], PARTS.peak))
    flags = np.zeros(len(held), bool)
    flags[places[along[places] > PARTS.likely * peak]] = True
    cores = components(flags, surface.edges, surface.area) or [places]
    at = surface.places.at / np.median(surface.places.pixel)
    away = np.stack([cKDTree(at[core]).query(at)[0] for core in cores])
    nearest, inside = away.argmin(axis=0), np.isin(np.arange(len(held)), places)
    # What lies about a region and does not contradict half of its motion may have gone along, too faintly to be seen.
    may = held & (away.min(axis=0) < PARTS.about) & (along + PARTS.sure * sure > PARTS.likely * peak)
    most, least = may | (inside & (along > PARTS.most * peak)), inside & (along > PARTS.least * peak)
    parts = []
    for index, core in enumerate(cores):
        own = nearest == index
        fewest, widest = (np.flatnonzero(own & some) for some in (least, most))
        supports = core, _some(fewest, core), np.union1d(widest, core)
        parts.append(Part(np.flatnonzero(own & inside), supports, _inner(found, core)))
    return parts


def _some(places: Indices, instead: Indices) -> Indices:
    return places if len(places) >= PARTS.places else instead


def _inner(found: Compared, core: Indices) -> Indices:
    """Places of a core that lie farthest from what is held and does not belong to it."""
    away = found.depth_of(core)
    inside = away > min(PARTS.inside, float(np.sort(away)[-min(PARTS.places, len(away))]) - 1e-9)
    return np.asarray(core[inside])


@dataclass(frozen=True)
class Sized:
    """How large the motions of parts are.

    Attributes:
        by: [K, 3] px-equivalents, as windows show them, times what they lack; deviation: [K] along them.
    """

    by: Array = field(repr=False)
    deviation: Array = field(repr=False)


def sized(found: Compared, parts: Sequence[Part]) -> Sized:
    """The motions of parts, all at once: one beside another shows in its windows, too."""
    members = _members([part.inner for part in parts], len(found.surface.places.at))
    shown = between(pooled(found.own, members), pooled(found.other, members))
    covariance = shown.covariance + found.common.spread(members)
    size = np.maximum(shown.size, 1e-12)
    way = shown.by / size[:, None]
    moving = _Moving(found)
    shares = np.stack([moving.shares([part.supports[k] for part in parts], members, shown.by) for k in range(3)])
    sizes = size / np.clip(shares, PARTS.lowest, 1.0)
    likely, reach = (sizes[0] + sizes[2]) / 2.0, np.ptp(sizes, axis=0) / 2.0
    deviation = np.sqrt(np.einsum("ki,kij,kj->k", way, covariance, way)) * likely / size
    return Sized(way * likely[:, None], np.hypot(deviation, reach))


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


class _Moving:
    """Moves parts of a surface before some of the later photos."""

    def __init__(self, found: Compared) -> None:
        surface, photos = found.surface, found.beside.twin
        self.about = About(surface.twin, photos, surface.places, step_of(photos))
        self.tree = cKDTree(surface.places.at)
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

    def shares(self, supports: Sequence[Indices], members: csr_array, wanted: Array) -> Array:
        """[K] share of motions that windows of members [K, N] show, where they show `wanted` [K, 3]."""
        size = np.linalg.norm(wanted, axis=1)
        way, share = wanted / np.maximum(size, 1e-12)[:, None], np.ones(len(supports))
        for _ in range(PARTS.rounds):
            true = wanted / np.clip(share, PARTS.lowest, 1.0)[:, None]
            everywhere = np.zeros((members.shape[1], 3))
            for places, by in zip(supports, true, strict=True):
                everywhere[places] = by
            seen = solved(pooled(self._evidence(everywhere), members)).by
            share = (seen * way).sum(axis=1) / np.maximum(np.linalg.norm(true, axis=1), 1e-12)
        return np.asarray(share)

    def _evidence(self, moved: Array) -> Evidence:
        """What photos would say if places had moved by [N, 3] px-equivalents."""
        found = []
        for photo in self.photos:
            by = np.where(photo.nearest[..., None] >= 0, moved[photo.nearest], 0.0)
            change = torch.from_numpy((photo.by_motion * by[None]).sum(axis=-1)).float()
            with torch.no_grad():  # (small, as blur may act on light: what it makes of a change is its derivative)
                shown = photo.shown.degraded(photo.shown.sharp + PARTS.small * change).numpy()
            difference = photo.light.without((shown - photo.shown.image) / PARTS.small)
            found.append((*self.about.said(photo.shown, difference, photo.light), photo.light.gain))
        return Evidence(*(np.stack(part).astype(np.float32) for part in zip(*found, strict=True)))


def _local(camera: Camera, depth: NDArray[np.float32]) -> Array:
    """[H W, 3] what each px shows, in the camera's own axes."""
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)
    return np.asarray((rays * depth[..., None]).reshape(-1, 3))
