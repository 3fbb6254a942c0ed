"""From photos and known cameras to points on surfaces: the row of all steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..errors import Cancelled
from ..imaging.medium import Medium
from ..numbers import number
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from ..sfm.triangulate import Triangulated
from ..views import SparsePoints
from .agreement import agreed
from .choice import chosen_references, neighbours_of
from .depths import KnownScene, depth_bounds, found_features
from .far import far_samples, open_views
from .fill import filled_maps
from .guess import guessed_from, unconfirmed
from .hull import Hull, carved_hull
from .hull_points import hull_samples
from .maps import samples_of, share_confirmed, wanted_pixels
from .smaller import SmallerSettings
from .speckles import without_speckles
from .stack import StackSettings, stack_views
from .sweep import DepthMap, swept
from .union import merged_in


@dataclass(frozen=True)
class SurfaceSettings:
    """Of what becomes of the steps' findings.

    Attributes:
        hurried: depths are sought on smaller views.
        smaller: when they are sought on smaller views anyway.
    """

    hurried: bool = False
    smaller: SmallerSettings = SmallerSettings()
    hurried_side: int = number(
        160,
        "px",
        "of a small view where time is short. Fewer views, 12 of 48, saved as much, and lost the surfaces: none of them"
        " had two witnesses (photos agreed on 6 % of a room's depths instead of 49)",
        "the first value that was tried; a room rendered by Cycles: 5.1 s for 8.4, photos agree on 52 % of the depths",
        "village, whole runs of 20 s: 18.6 -> 32.1 dB; the orrery showed that thin things need `StackSettings.shown`",
    )
    trusted: float = number(
        0.2, "confidence", "that a sample which several views see has at least", FIRST_TRIED, LOOKED_AT
    )
    guessed: float = number(
        0.1, "confidence", "of a sample between trusted ones: 0.5 is the same", FIRST_TRIED, LOOKED_AT
    )
    carved: float = number(
        0.05, "confidence", "of a sample on the visual hull: the surface is there or behind", FIRST_TRIED, LOOKED_AT
    )
    side: float = number(
        1.0,
        "px of a small view",
        "side of the cells that hold one point each. Cells as large as they must be for `points` are worse: they"
        " blunt what was measured, and what many views see gets no more points than the rest",
        "as around known points; drafts at given cameras with it instead of even cells: room 26.63 -> 26.74 dB,"
        " ball 27.90 -> 28.15 (means of three seeds)",
        "lego 30.16 -> 30.54, banana 24.04 -> 24.56, another flight 30.44 -> 30.94, village from above level,"
        " shelf and copr 0.1 worse; 3 s less",
    )
    points: int = number(
        60000,
        "count",
        "points at most: a training of 100,000 Gaussians begins with fewer than it ends",
        FIRST_TRIED,
        LOOKED_AT,
    )
    minimum_samples: int = number(
        500, "samples", "that several views must see before they count as surfaces", FIRST_TRIED, LOOKED_AT
    )
    minimum_features: int = number(
        50, "points", "that features must give before they stand for surfaces on their own", FIRST_TRIED, LOOKED_AT
    )


SETTINGS = SurfaceSettings()


@dataclass(frozen=True)
class FoundSurface:
    """What was found.

    Attributes:
        points: dense with confidence; sparse ones where only features were found; None at all where nothing was.
        words: where they come from, in a sentence; empty where there are none.
        warnings: what the user should know of the cameras.
    """

    points: SparsePoints = field(repr=False)
    words: str
    warnings: tuple[str, ...] = ()


def surface_points(
    photos: Sequence[Photo],
    cameras: Reconstruction,
    medium: Medium,
    work_dir: Path,
    threads: int,
    progress: Progress,
    settings: SurfaceSettings = SETTINGS,
) -> FoundSurface:
    """A first surface from photos whose cameras are known.

    Args:
        photos: of any size; those without a camera are left out.
        medium: the blur is undone before anything is compared.
        work_dir: where the child process that triangulates may make a folder; threads: of that process.
        progress: hears of each view; may cancel.

    Raises:
        Cancelled: the user asked to stop.
    """
    seen = [photo for photo in photos if photo.name in cameras.poses]
    progress.stage("surface")
    small = StackSettings(longest_side=settings.hurried_side) if settings.hurried else StackSettings()
    views = stack_views(seen, cameras, medium, small)
    scene = KnownScene(seen, cameras, medium, views, carved_hull(views))
    features, warning = found_features(scene, work_dir, threads, progress)
    warnings = (warning,) if warning else ()
    checked = _confirmed(scene, features, progress)
    # (what a hull bounds may be as thin as a px)
    if scene.object is None and settings.smaller.asked(share_confirmed(checked, views)):
        scene, checked = _smaller(scene, checked, small, features, progress, settings)
        views = scene.views
    trusted = samples_of(checked, views, settings.trusted)
    if len(trusted) < settings.minimum_samples:
        points, words = _without_maps(scene, features, settings)
        return FoundSurface(points, words, warnings)
    wanted = [wanted_pixels(views, one.view) for one in checked]
    filled = filled_maps(checked, views, wanted, scene.hull)
    if scene.object is not None:
        guessed, beyond = filled, hull_samples(scene.object, views, checked, settings.carved)
    else:
        guessed = _guessed(checked, features, scene)
        beyond = far_samples(open_views(checked, filled, wanted), trusted.positions, views, settings.carved)
    parts = [trusted, samples_of(guessed, views, settings.guessed, even=True), beyond]
    points = merged_in(parts, settings.side, settings.points)
    share = share_confirmed(checked, views)
    words = f"{len(points.positions)} points on surfaces: photos agree on the depth of {share:.0%} of what they show"
    return FoundSurface(points, words, warnings)


def _confirmed(scene: KnownScene, features: Triangulated | None, progress: Progress) -> list[DepthMap]:
    """What views agree on, in those that are swept."""
    checked = agreed(_maps(scene, chosen_references(scene.views), features, progress), scene.views)
    # A hull leaves chance no room before the object, and wires of a px are islands, too.
    return checked if scene.object is not None else without_speckles(checked)


def _smaller(
    scene: KnownScene,
    checked: list[DepthMap],
    small: StackSettings,
    features: Triangulated | None,
    progress: Progress,
    settings: SurfaceSettings,
) -> tuple[KnownScene, list[DepthMap]]:
    """The same on views of half the size, where these agree on clearly more: photos may be blurred, each in its way."""
    half = replace(small, longest_side=small.longest_side // 2)
    other = replace(scene, views=stack_views(scene.photos, scene.cameras, scene.medium, half))
    found = _confirmed(other, features, progress)
    shares = share_confirmed(checked, scene.views), share_confirmed(found, other.views)
    return (other, found) if settings.smaller.taken(*shares) else (scene, checked)


def _maps(
    scene: KnownScene, references: Sequence[int], features: Triangulated | None, progress: Progress
) -> list[DepthMap]:
    """A map of each of the views in `references`."""
    progress.stage("surface", len(references))
    maps = []
    ranges = depth_bounds(references, scene, features)
    for done, (view, bounds) in enumerate(zip(references, ranges, strict=True), start=1):
        if progress.cancelled():
            raise Cancelled("Stopped while looking for surfaces")
        others = neighbours_of(view, scene.views, *bounds)
        maps.append(swept(view, scene.views, others, bounds, wanted_pixels(scene.views, view), scene.hull))
        progress.advance(done)
    return maps


def _guessed(checked: Sequence[DepthMap], features: Triangulated | None, scene: KnownScene) -> list[DepthMap]:
    """Depths of every px that has none, between those of its view and the features'."""
    points = np.zeros((0, 3)) if features is None or features.contradicts else features.positions
    return unconfirmed([guessed_from(one, points, scene.views) for one in checked], checked, scene.views, scene.hull)


def _without_maps(
    scene: KnownScene, features: Triangulated | None, settings: SurfaceSettings
) -> tuple[SparsePoints, str]:
    """What is left where views do not agree on depths: the hull, or features, or nothing."""
    hull: Hull | None = scene.hull
    if hull is not None and hull.bounded:
        points = merged_in([hull_samples(hull, scene.views, [], settings.carved)], settings.side, settings.points)
        return points, f"{len(points.positions)} points on the hull of what the photos leave open: they show no depth"
    if features is None or len(features.positions) < settings.minimum_features or features.contradicts:
        return SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8)), ""
    words = f"{len(features.positions)} features that were triangulated: the photos show no more"
    return SparsePoints(features.positions, features.colours), words
