"""Surfaces where the twin's pictures of them agree, rather than where its splats hold back the light.

Where photos say little of a depth, behind a blur above all, splats stand in layers before the surface that show every
photo as it is: their own depths are off by several px, all views' by the same. What they show is right nevertheless. So
each view's picture is compared with its neighbours', window by window, at depths around the twin's (plane sweep,
Collins 1996, in bands that follow the surface), and a place is believed that several views find by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ..compiled import run, threads
from ..errors import Cancelled, DgsError
from ..numbers import number
from ..opencv import opencv
from ..progress import Progress
from ..sfm.sharpen import LUMA
from ..surface.agreement import AgreementSettings, agreed, lifted_map
from ..surface.choice import ChoiceSettings, neighbours_of
from ..surface.stack import ViewStack, stack_pictures
from ..surface.sweep import Around, DepthMap, SweepSettings, swept
from .matching_kernels import nearest_places, smooth_between_steps
from .surfaces import Floats, SeenSurface, weights

#: How a mesh's depths come about: matched and filled, matched alone, or the twin's own.
Matching = Literal["filled", "agreed", "off"]

_CHOSEN = "meshes of the rendered shelf and orrery, sharp and blurred by 5 px"
_CHECKED = "meshes of the rugby ball; of the village, which was looked at on the way"
_FIRST = "the first and only value"

#: What needs OpenCV, and how one does without.
_NEEDED = ("Meshes of matched views", "take --matching off")


@dataclass(frozen=True)
class MatchingSettings:
    """Of the comparison, of what is believed, and of what is made of the rest."""

    bands: tuple[tuple[float, int], ...] = number(
        ((12.0, 25), (2.0, 11)),
        "px on the surface, count",
        "by which a surface may lie off its depth, and how many depths are tried there; the second band lies around"
        " what the first one found. 20 px are less exact, 6 px find less",
        _CHOSEN,
        _CHECKED,
    )
    radius: int = number(2, "px", "windows of (2 radius + 1)^2 px are compared; 3 loses thin things", _CHOSEN, _CHECKED)
    neighbours: int = number(
        4, "views", "that each is compared with; the better half decides. 8 take twice as long", _CHOSEN, _CHECKED
    )
    texture: float = number(
        0.004,
        "share of white",
        "standard deviation of a window below which it shows nothing; half of it alike",
        _CHOSEN,
        _CHECKED,
    )
    largest_cost: float = number(
        0.8, "1 - correlation", "of the best depth; what is wrong is refused by other views", _FIRST, _CHECKED
    )
    sure_margin: float = number(
        0.1, "correlation", "by which a depth beats all others that is as sure as can be", _FIRST
    )
    agreeing: float = number(
        1.0, "px on the surface", "within which two views have found the same place", _CHOSEN, _CHECKED
    )
    through: float = number(3.0, "px on the surface", "behind a place, from which on a view looks through it", _FIRST)
    witnesses: int = number(
        3,
        "views",
        "that must have found the same place besides; one of less than 8 views; 2 are less exact",
        _CHOSEN,
        _CHECKED,
    )
    median: int = number(
        5,
        "px",
        "side of the window whose median replaces the twin's depth, 3 or 5: single splats go",
        _CHOSEN,
        _CHECKED,
    )
    smooth: float = number(
        1.5, "px", "standard deviation of the mean that its depths are then replaced by", _CHOSEN, _CHECKED
    )
    step: float = number(0.02, "share of the depth", "beyond which two px lie on two surfaces", _FIRST)
    least_sure: float = number(0.05, "share", "of the weight that a believed place has at least", _FIRST)
    alike: float = number(
        3.0,
        "px on the surface",
        "within which two views see the same of the twin's own depths; they fill what is left where at least two do",
        _CHOSEN,
        _CHECKED,
    )
    filling: float = number(1e-3, "share", "of the weight that it then has: none beside a believed place", _FIRST)


MATCHING = MatchingSettings()


def matched_surfaces(
    surfaces: Sequence[SeenSurface], how: Matching, progress: Progress, settings: MatchingSettings = MATCHING
) -> tuple[list[SeenSurface], float]:
    """The surfaces with depths that views agree on, and the share of what is seen where they do (1 if not asked).

    Args:
        surfaces: the twin's own, of all views.
        how: 'agreed': only what views find alike; 'filled': also the twin's own depth where a view sees no such place,
            and another view sees that depth alike; 'off': nothing is changed.

    Raises:
        DgsError: 'agreed', and nothing is; OpenCV is missing. Cancelled: the user asked to stop.
    """
    if how == "off" or len(surfaces) < 2:
        return list(surfaces), 1.0
    opencv(*_NEEDED)
    pictures = [np.tensordot(np.array(LUMA, np.float32), s.image, 1) for s in surfaces]
    views = stack_pictures([s.camera for s in surfaces], pictures, [s.weight > 0 for s in surfaces])
    own, maps = _all_matched(surfaces, views, progress, settings)
    px = 1.0 / float(np.median(views.focals))
    # A mesh holds what is sure: a lone witness starts a training, and makes no surface.
    asked = AgreementSettings(settings.agreeing * px, settings.through * px, settings.witnesses, settings.witnesses)
    believed = agreed(maps, views, asked)
    found = sum(int((one.depth > 0).sum()) for one in believed)
    share = found / max(1, sum(int((s.weight > 0).sum()) for s in surfaces))
    joined = [_joined(surface, one, settings) for surface, one in zip(surfaces, believed, strict=True)]
    if how == "agreed":
        if not found:
            raise DgsError("Cameras agree on no surface of the twin", "Take --matching filled, or give more photos")
        return joined, share
    filling = _filling(own, believed, views, px, settings)
    if not found and not any((one.depth > 0).any() for one in filling):
        return list(surfaces), 0.0  # cameras that see nothing in common
    return [_filled(surface, one, settings) for surface, one in zip(joined, filling, strict=True)], share


def _all_matched(
    surfaces: Sequence[SeenSurface], views: ViewStack, progress: Progress, settings: MatchingSettings
) -> tuple[list[DepthMap], list[DepthMap]]:
    """Of each view: its own depth, smooth, and what it finds by itself around that."""

    def both(index: int) -> tuple[DepthMap, DepthMap]:
        smooth = _smooth_map(index, surfaces[index], views, settings)
        return smooth, _matched(smooth, surfaces[index].camera.fx, views, settings)

    progress.stage("match", len(surfaces))
    found: list[tuple[DepthMap, DepthMap]] = []
    pool = ThreadPoolExecutor(min(2, threads()))  # (a tenth of each view's work runs on one core; more take memory)
    try:
        for pair in pool.map(both, range(len(surfaces))):
            if progress.cancelled():
                raise Cancelled(f"Stopped after {len(found)} of {len(surfaces)} views; nothing was written")
            found.append(pair)
            progress.advance(len(found))
    finally:
        pool.shutdown(cancel_futures=True)
    return [smooth for smooth, _ in found], [matched for _, matched in found]


def _filling(
    own: Sequence[DepthMap], believed: Sequence[DepthMap], views: ViewStack, px: float, settings: MatchingSettings
) -> list[DepthMap]:
    """The twin's own depths where nothing else is believed, and another view sees them alike; `px` per depth."""
    left = [
        replace(one, depth=np.where((other.depth > 0) | _elsewhere(one.depth, nearest, px, settings), 0.0, one.depth))
        for one, other, nearest in zip(own, believed, _nearest(believed, views), strict=True)
    ]
    twice = AgreementSettings(settings.alike * px, settings.through * px, witnesses=1)
    return agreed(left, views, twice, among=own)


def _smooth_map(index: int, surface: SeenSurface, views: ViewStack, settings: MatchingSettings) -> DepthMap:
    """The twin's own depth, smooth; 0 where it has none."""
    height, width = surface.depth.shape
    depth = np.zeros(views.counts.shape[1:], np.float32)
    seen = surface.weight > 0
    if seen.any():
        smooth = smooth_depth(np.where(seen, surface.depth, np.nan).astype(np.float64), settings)
        depth[:height, :width] = np.where(seen, smooth, 0.0)
    return DepthMap(index, depth, (depth > 0).astype(np.float32))


def _matched(own: DepthMap, focal: float, views: ViewStack, settings: MatchingSettings) -> DepthMap:
    """What a view finds by itself around its own depth, band after band."""
    wanted = own.depth > 0
    found = DepthMap(own.view, np.zeros(wanted.shape, np.float32), np.zeros(wanted.shape, np.float32))
    if not wanted.any():
        return found
    around = np.where(wanted, own.depth, np.median(own.depth[wanted])).astype(np.float64)
    near, far = np.percentile(around[wanted], (2.0, 98.0))
    others = neighbours_of(own.view, views, near, far, ChoiceSettings(neighbours=settings.neighbours))
    for place, (band, planes) in enumerate(settings.bands):
        if place:
            around = smooth_depth(np.where(wanted, np.where(found.depth > 0, found.depth, around), np.nan), settings)
        asked = SweepSettings(
            planes=planes,
            radius=settings.radius,
            texture=settings.texture,
            largest_cost=settings.largest_cost,
            least_margin=0.0,
            sure_margin=settings.sure_margin,
            fewest=2,
        )
        found = swept(own.view, views, others, Around(around, band / focal), wanted, None, asked)
    return found


def smooth_depth(depth: NDArray[np.float64], settings: MatchingSettings = MATCHING) -> NDArray[np.float64]:
    """[H, W] a depth map without holes (NaN) and single px, smooth but for steps; planes stay planes."""
    holes = ~np.isfinite(depth)
    nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)
    inverse = (1.0 / depth[tuple(nearest)]).astype(np.float32)
    # (scipy's takes 25 times as long, on one thread)
    inverse = opencv(*_NEEDED).medianBlur(np.ascontiguousarray(inverse), settings.median).astype(np.float64)
    out = np.empty_like(inverse)
    run(smooth_between_steps, len(inverse), inverse, settings.smooth, settings.step, out, grain=8)
    return np.asarray(1.0 / out)


def _nearest(maps: Sequence[DepthMap], views: ViewStack) -> Floats:
    """[V, H, W] how far away each view sees a place that is believed; infinite where it sees none."""
    places = np.concatenate([lifted_map(one, views) for one in maps])
    nearest = np.full(views.counts.shape, np.inf, np.float32)
    run(nearest_places, len(views), places, views.projections, views.offsets, views.sizes, nearest)
    return nearest


def _elsewhere(own: Floats, nearest: Floats, px: float, settings: MatchingSettings) -> NDArray[np.bool_]:
    """Px whose own depth is not that of the place which is believed there."""
    return np.isfinite(nearest) & (np.abs(own - nearest) > settings.alike * px * own)


def _joined(surface: SeenSurface, one: DepthMap, settings: MatchingSettings) -> SeenSurface:
    """What is believed of a view."""
    height, width = surface.depth.shape
    depth = one.depth[:height, :width]
    depth = np.where(depth > 0, depth, np.float32(np.nan))
    sure = np.maximum(one.confidence[:height, :width], np.float32(settings.least_sure))
    return SeenSurface(surface.camera, depth, weights(depth, surface.camera) * sure, surface.image)


def _filled(believed: SeenSurface, other: DepthMap, settings: MatchingSettings) -> SeenSurface:
    """With another depth where that has one, at little weight."""
    height, width = believed.depth.shape
    kept = other.depth[:height, :width] > 0
    own = np.where(kept, other.depth[:height, :width], np.float32(np.nan))
    weight = np.float32(settings.filling) * weights(own, believed.camera)
    return replace(believed, depth=np.where(kept, own, believed.depth), weight=np.where(kept, weight, believed.weight))
