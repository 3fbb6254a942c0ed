"""Two twins in, their changes out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..errors import NoOverlap
from ..evaluation.poses import Similarity
from ..progress import Progress
from ..twin.opened import OpenedTwin
from .alignment import SAME, composed, inverse, matched_worlds
from .evidence import Evidence, evidence
from .findings import Alignment, Changes, Region
from .kinds import regions_of, vanished_of
from .motion import common_motion, enough, paired
from .pair import Compared
from .regions import tested
from .settings import ALIGNMENT, REGIONS
from .surface import Surface, behind, surface_of

_APART = "The twins share too little: hardly a place of the first is seen in enough photos of the second"
_WAY_OUT = "Give twins of one object, photographed from alike sides"


def changes(
    before: OpenedTwin, later: OpenedTwin, threads: int, progress: Progress
) -> tuple[Changes, Surface, Surface]:
    """What has changed between two twins, and both surfaces, each in its own world.

    Raises:
        NoOverlap: they share too little, or their worlds cannot be aligned. DgsError: there is no surface.
        Cancelled: the user asked to stop.
    """
    first, second = surface_of(before, progress), surface_of(later, progress)
    own = evidence(before, before, first.places, progress)
    world, how, matches = SAME, "same world", 0
    other = evidence(before, later, first.places, progress)
    if not _fits(own, other):
        world, matches = matched_worlds(first, second, threads, progress)
        how, other = "matched photos", evidence(before, later, first.places, progress, world.camera)
    found, world = _refined(first, second, own, other, world, progress)
    swapped = _swapped(first, second, world, progress)
    aligned = Alignment(world, how, matches, *_left(found))
    return _said(found, swapped, aligned), first, second


def _fits(own: Evidence, other: Evidence) -> bool:
    """Whether photos show a surface where it is."""
    held = enough(own, other)
    if held.sum() < REGIONS.shared * max(1, len(held)):
        return False
    sees = own.sees & held, other.sees & held
    usual, found = (float(np.median(e.energies[s])) for e, s in zip((own, other), sees, strict=True))
    return found < ALIGNMENT.contrary * usual


def _refined(
    first: Surface, second: Surface, own: Evidence, other: Evidence, world: Similarity, progress: Progress
) -> tuple[Compared, Similarity]:
    """What the unchanged majority moves by in common is the worlds' difference, and is taken out."""
    for _ in range(ALIGNMENT.rounds):
        if enough(own, other).sum() < REGIONS.shared * len(own.seen):
            raise NoOverlap(_APART, _WAY_OUT)
        rows = _paired(first, second, own, other, world)
        common = common_motion(*rows, first.places)
        if float(np.abs(common.by[enough(own, other)]).max()) < ALIGNMENT.still:
            break
        world = composed(inverse(Similarity(*common.similarity(), rank=3)), world)
        other = evidence(first.twin, second.twin, first.places, progress, world.camera)
    return _compared(first, second, _paired(first, second, own, other, world), world), world


def _swapped(first: Surface, second: Surface, world: Similarity, progress: Progress) -> Compared:
    """The second twin's surface before both sets of photos: what is new stands on it only."""
    back = inverse(world)
    own = evidence(second.twin, second.twin, second.places, progress)
    other = evidence(second.twin, first.twin, second.places, progress, back.camera)
    return _compared(second, first, _paired(second, first, own, other, back), back)


def _paired(
    surface: Surface, beside: Surface, own: Evidence, other: Evidence, into: Similarity
) -> tuple[Evidence, Evidence]:
    cameras = [into.camera(camera) for camera in beside.cameras]
    return paired(own, other, (surface.cameras, cameras), surface.places)


def _compared(surface: Surface, beside: Surface, rows: tuple[Evidence, Evidence], into: Similarity) -> Compared:
    """A surface's places before both sets of photos.

    Args:
        into: from the world of the surface `beside` into its own.
    """
    own, other = rows
    common, out = common_motion(own, other, surface.places), inverse(into)
    first = tested(own, other.moved(common.by), surface.places, common)
    still = first.held & ~first.moved & ~first.gone
    if still.sum() > REGIONS.shared * first.held.sum():  # (what has moved draws the whole its way, however little)
        common = common_motion(own, other, surface.places, still)
    other = other.moved(common.by)
    cameras = surface.cameras[:: max(1, len(surface.cameras) // REGIONS.depths)]
    farther = behind(beside.twin, [out.camera(camera) for camera in cameras], out.points(surface.places.at))
    gap = farther / (out.scale * surface.places.pixel)
    return Compared(surface, beside, own, other, common, tested(own, other, surface.places, common), gap, into)


def _left(found: Compared) -> tuple[float, float]:
    """Standard deviation that is left of the alignment, in the median of the surface, and what was taken out last."""
    held = found.tested.held
    spread = np.trace(found.common.spread()[held], axis1=1, axis2=2)
    return float(np.sqrt(np.median(spread))), float(np.abs(found.common.by[held]).max())


def _new(swapped: Compared, world: Similarity) -> list[Region]:
    """What stands on the second surface only, in the first world: what has vanished, seen from there."""
    return [
        replace(one, kind="appeared", centre=world.points(one.centre), pixel=one.pixel * world.scale, after=True)
        for one in vanished_of(swapped)
    ]


def _said(found: Compared, swapped: Compared, aligned: Alignment) -> Changes:
    """What is new is said once, on the second surface: what is behind it is seen by no photo any more."""
    new = _new(swapped, aligned.similarity)
    there = np.concatenate([swapped.surface.places.at[one.places] for one in new] or [np.zeros((0, 3))])
    near = cKDTree(aligned.similarity.points(there))
    kept = [one for one in regions_of(found) if one.kind == "vanished" or not _beside(found.surface, one, near)]
    held, surface = found.tested.held, found.surface
    touched = np.unique(np.concatenate([one.places for one in kept] or [np.zeros(0, int)]))
    whole = float(surface.area[held].sum())
    mediums = tuple(str(one.twin.settings.medium.psf) for one in (found.surface, found.beside))
    return Changes(
        tuple(sorted([*kept, *new], key=lambda region: -region.area)),
        aligned,
        len(held),
        held,
        float(surface.area[touched].sum()) / max(whole, 1e-12),
        float(np.median(found.other.gains[found.other.gains > 0]) / np.median(found.own.gains[found.own.gains > 0])),
        (mediums[0], mediums[1]),
        found.tested.motion.size,
        np.sqrt(np.trace(found.tested.motion.covariance, axis1=1, axis2=2)),
    )


def _beside(surface: Surface, region: Region, near: cKDTree) -> bool:
    """Whether most of a region lies about what is new, where windows and blur see that."""
    if not near.n:
        return False
    away = near.query(surface.places.at[region.places])[0] / region.pixel
    return bool(np.mean(away < REGIONS.halo) > 0.5)
