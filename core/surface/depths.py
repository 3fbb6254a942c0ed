"""Between which depths a view's surfaces lie: by the hull, by triangulated features, or by where the cameras look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import CameraError, Cancelled
from ..imaging.medium import Medium
from ..numbers import number
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..sfm.provenance import FIRST_TRIED, LOOKED_AT
from ..sfm.scatter import closest_point
from ..sfm.settings import SfmSettings
from ..sfm.triangulate import Triangulated, triangulate
from .choice import chosen_references, most_alike, neighbours_of
from .hull import Hull
from .stack import Floats, ViewStack


@dataclass(frozen=True)
class DepthSettings:
    """Of features at known poses, and of the range of depths."""

    feature_photos: int = number(
        50,
        "photos",
        "evenly chosen, in which features are sought: a few thousand true points show the depths",
        FIRST_TRIED,
        LOOKED_AT,
    )
    pair_distances: tuple[float, ...] = number(
        (0.5, 1.0, 2.0),
        "guessed distances",
        "at which pairs of photos are looked for before any depth is known",
        FIRST_TRIED,
        LOOKED_AT,
    )
    nearest: float = number(
        0.7, "share", "of the nearest point's depth, where the planes begin", FIRST_TRIED, LOOKED_AT
    )
    farthest: float = number(1.6, "share", "of the farthest point's depth, where they end", FIRST_TRIED, LOOKED_AT)
    stray: float = number(
        2.0, "percent", "of the points at each end that do not count as nearest and farthest", FIRST_TRIED, LOOKED_AT
    )
    minimum_seen: int = number(20, "points", "that a view must see before its own depths count", FIRST_TRIED, LOOKED_AT)
    blind_nearest: float = number(
        0.3, "share", "of the guessed distance: begin, where nothing is found", FIRST_TRIED, LOOKED_AT
    )
    blind_farthest: float = number(
        3.0, "share", "of the guessed distance: end, where nothing is found", FIRST_TRIED, LOOKED_AT
    )
    alike: int = number(
        3,
        "views",
        "whose depths a view takes that too few features are in",
        "the first value that was tried; a village from above, 30 photos: drafts of 25.88 -> 26.29 dB",
        "the same photos shaken 23.42 -> 24.49; four other sets have no such view",
    )
    ahead: float = number(
        0.3,
        "spread of the cameras",
        "by which the point where they look must lie before one that looks at it",
        FIRST_TRIED,
        LOOKED_AT,
    )
    closest: float = number(
        0.05, "share", "of the farthest depth at which the planes begin at the nearest", FIRST_TRIED, LOOKED_AT
    )


SETTINGS = DepthSettings()


@dataclass(frozen=True)
class KnownScene:
    """What is known at the beginning: photos with their cameras, their blur, small views of them, and a hull if any."""

    photos: Sequence[Photo]
    cameras: Reconstruction
    medium: Medium
    views: ViewStack
    hull: Hull | None

    @property
    def object(self) -> Hull | None:
        """The hull, where it holds all there is."""
        return self.hull if self.hull is not None and self.hull.bounded else None


def found_features(
    scene: KnownScene, work_dir: Path, threads: int, progress: Progress
) -> tuple[Triangulated | None, str]:
    """Features triangulated at the known poses, and what the user should know of the cameras ('' for nothing).

    Raises:
        Cancelled: the user asked to stop.
    """
    views, psf = scene.views, scene.medium.psf
    chosen = chosen_references(views, count=SETTINGS.feature_photos)
    pairs = sorted({pair for view in chosen for pair in _pairs(view, scene, chosen)})
    if not pairs:
        return None, ""
    kernel = None if psf is None or psf.is_identity else psf.kernel()
    some = [scene.photos[index] for index in chosen]
    named = [(views.names[a], views.names[b]) for a, b in pairs]
    try:
        found = triangulate(some, scene.cameras, named, kernel, SfmSettings(threads=threads), work_dir, progress)
    except Cancelled:
        raise
    except CameraError as error:  # the sweep does without
        return None, f"No features were triangulated: {error.what}"
    if not found.contradicts:
        return found, ""
    return found, (
        f"The given cameras may not be those of the photos: only {found.on_lines:.0%} of {found.matches} matches"
        " between photos lie where these cameras allow"
    )


def _pairs(view: int, scene: KnownScene, chosen: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of a view with others that may see the same, at whatever depth it lies."""
    among = np.zeros(len(scene.views), bool)
    among[chosen] = True
    bounds = None if scene.object is None else scene.object.near_far(scene.views, view)
    distance = _distance(view, scene.views)
    ranges = (
        [bounds] if bounds is not None else [(0.5 * distance * k, 2 * distance * k) for k in SETTINGS.pair_distances]
    )
    others = np.concatenate([neighbours_of(view, scene.views, *one, among=among) for one in ranges])
    return [(min(view, int(other)), max(view, int(other))) for other in others]


def depth_bounds(views: Sequence[int], scene: KnownScene, features: Triangulated | None) -> list[tuple[float, float]]:
    """Depths between which the surfaces of each of these views are sought, world units.

    A view that too few features are in takes the depths of those most like it in place and direction.
    """
    own = [_own_bounds(view, scene, features) for view in views]
    known = [view for view, bounds in zip(views, own, strict=True) if bounds is not None]
    theirs = np.array([bounds for bounds in own if bounds is not None])
    found = []
    for view, bounds in zip(views, own, strict=True):
        if bounds is None and known:
            alike = theirs[most_alike(view, known, scene.views, SETTINGS.alike)]
            bounds = float(alike[:, 0].min()), float(alike[:, 1].max())
        found.append(_blind_bounds(view, scene.views) if bounds is None else bounds)
    return found


def _own_bounds(view: int, scene: KnownScene, features: Triangulated | None) -> tuple[float, float] | None:
    """By the hull, or by the features in the view; None where neither says anything."""
    bounds = None if scene.object is None else scene.object.near_far(scene.views, view)
    if bounds is not None:
        return max(bounds[0], SETTINGS.closest * bounds[1]), bounds[1]
    if features is None:
        return None
    own = _seen_by(view, scene.views, features)
    depth = own if len(own) >= SETTINGS.minimum_seen else scene.views.depths(view, features.positions)[1]
    if len(depth) < SETTINGS.minimum_seen:
        return None
    near, far = np.percentile(depth, [SETTINGS.stray, 100.0 - SETTINGS.stray])
    return SETTINGS.nearest * float(near), SETTINGS.farthest * float(far)


def _blind_bounds(view: int, views: ViewStack) -> tuple[float, float]:
    """By where the cameras look alone."""
    distance = _distance(view, views)
    return SETTINGS.blind_nearest * distance, SETTINGS.blind_farthest * distance


def _distance(view: int, views: ViewStack) -> float:
    """How far away the scene may be: where all cameras look; else the spread of the cameras."""
    focus = closest_point(views.centres, views.rotations[:, 2])
    spread = float(np.sqrt(((views.centres - views.centres.mean(0)) ** 2).sum(1).mean()))
    ahead = float(views.rotations[view, 2] @ (focus - views.centres[view]))
    return ahead if ahead > SETTINGS.ahead * spread else spread


def _seen_by(view: int, views: ViewStack, features: Triangulated) -> Floats:
    """Depths of the points that were found in this view itself."""
    name = views.names[view]
    if name not in features.names:
        return np.zeros(0)
    own = features.observations[features.observations[:, 1] == features.names.index(name), 0]
    depth = (features.positions[own] - views.centres[view]) @ views.rotations[view, 2]
    return np.asarray(depth[depth > 0])
