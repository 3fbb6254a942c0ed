"""A first surface around points that structure from motion found: guessed between them, then sought in a narrow band.

The guess spares most of what makes planes at cameras without points slow: features, and planes over the whole range of
depths, which are only tried where the band held nothing. What nobody confirms stays where it was guessed, faint, unless
a photo looks through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .. import compiled
from ..errors import Cancelled
from ..imaging.medium import Medium
from ..numbers import number
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..views import SparsePoints
from .agreement import AgreementSettings, agreed, compared
from .choice import ChoiceSettings, chosen_references, neighbours_of, spread_poses
from .guess import GuessSettings, guessed_between, thinned, unconfirmed, unhidden
from .hull import Hull, carved_hull
from .maps import samples_of, share_confirmed, wanted_pixels
from .missed import with_missed
from .smaller import SmallerSettings
from .stack import Floats, StackSettings, ViewStack, stack_views
from .sweep import Around, DepthMap, SweepSettings, swept
from .union import Samples, merged_in

#: What the numbers below were chosen on, and checked on: docs/studies/points.md.
_CHOSEN = "copr, sharp, 400 px, and a room rendered by Cycles: drafts"
_CHECKED = "copr blurred, banana and brighton, sharp and blurred: drafts"


@dataclass(frozen=True)
class SeededSettings:
    """Of the surface around known points.

    Attributes:
        guess: of the depths between the points.
        smaller: when the smaller views are asked where the larger ones were.
    """

    guess: GuessSettings = GuessSettings()
    smaller: SmallerSettings = SmallerSettings()

    longest_side: tuple[int, int] = number(
        (128, 256),
        "px",
        "of a small view: of blurred photos, and of those whose blur is narrower than one of the larger px, where thin"
        " things are seen",
        "a shelf rendered by Cycles, cameras found, draft: 128 28.2 dB, 256 30.0; a room: 25.0, 24.8",
        "a village blurred by 3 px, copr, banana and brighton blurred by 5 px: 256 is 0.3 dB better (copr), level"
        " or worse (brighton, 0.2; 150 px 0.3)",
    )
    photos: int = number(
        96, "photos", "that are looked at, evenly chosen: making them small takes longer than the rest"
    )
    references: int = number(32, "views", "that are swept: 16 were 0.4 dB worse in the room", _CHOSEN, _CHECKED)
    neighbours: int = number(2, "views", "that each is compared with; the better one decides", _CHOSEN, _CHECKED)
    planes: int = number(16, "count", "depths that are tried around each guess", _CHOSEN, _CHECKED)
    band: float = number(
        0.25,
        "share of the depth",
        "by which a surface may lie off its guess: more needs more planes",
        _CHOSEN,
        _CHECKED,
    )
    witnesses: int = number(
        1, "views", "that must see the same surface: so coarse maps are few, and the band is narrow", _CHOSEN, _CHECKED
    )
    stray: float = number(2.0, "percent", "of the points at each end that do not say where neighbours must look")
    trusted: float = number(0.2, "confidence", "that a sample which several views see has at least", _CHOSEN, _CHECKED)
    guessed: float = number(0.5, "confidence", "of a sample that nobody confirms", _CHOSEN, _CHECKED)
    side: float = number(1.0, "px of a small view", "side of the cells that hold one sample each", _CHOSEN, _CHECKED)
    least_share: float = number(
        0.05, "share", "of what photos show that must be confirmed; else the photos say no more than the points"
    )
    minimum_samples: int = number(500, "samples", "that must be confirmed")


SETTINGS = SeededSettings()


@dataclass(frozen=True)
class SeededSurface:
    """What was found: dense samples with a confidence, and the share of what photos show that is confirmed."""

    samples: SparsePoints
    share: float


def seeded_surface(
    photos: Sequence[Photo],
    cameras: Reconstruction,
    medium: Medium,
    progress: Progress,
    settings: SeededSettings = SETTINGS,
) -> SeededSurface | None:
    """Samples of the surfaces that photos show, around the cameras' points; None where photos confirm too few.

    Args:
        photos: of any size; those without a camera are left out.
        medium: the blur is undone before anything is compared.
        progress: hears of each view; may cancel.

    Raises:
        Cancelled: the user asked to stop.
    """
    progress.stage("surface")
    seen = _spread([photo for photo in photos if photo.name in cameras.poses], cameras, settings.photos)
    if len(seen) < 2:  # nobody to confirm anything
        return None
    side = _side(seen, medium, settings)
    found = _confirmed(seen, cameras, medium, side, progress, settings)
    least = min(settings.longest_side)
    if side > least and settings.smaller.asked(found.share):
        other = _confirmed(seen, cameras, medium, least, progress, settings)
        found = other if settings.smaller.taken(found.share, other.share) else found
    confirmed = sum(int((one.depth > 0).sum()) for one in found.checked)
    if found.share < settings.least_share or confirmed < settings.minimum_samples:
        return None
    views = found.views
    trusted = samples_of(found.checked, views, settings.trusted)
    known = _known(cameras.points, trusted, found.checked, views)
    free = unconfirmed(found.guesses, found.checked, views, found.hull, settings.guess)
    parts = [trusted, known, samples_of(free, views, settings.guessed, even=True)]
    return SeededSurface(merged_in(parts, settings.side), found.share)


@dataclass(frozen=True)
class _Confirmed:
    """What small views show: a guess [H, W] and what is confirmed of each that was swept, and its share."""

    views: ViewStack
    hull: Hull | None
    guesses: list[Floats]
    checked: list[DepthMap]
    share: float


def _confirmed(
    seen: Sequence[Photo],
    cameras: Reconstruction,
    medium: Medium,
    side: int,
    progress: Progress,
    settings: SeededSettings,
) -> _Confirmed:
    """What views of at most `side` px confirm, around the points and where these lead to nothing."""
    views = stack_views(seen, cameras, medium, StackSettings(longest_side=side))
    hull = carved_hull(views)
    guesses, maps = _maps(views, cameras.points, hull, progress, settings)
    banded = agreed(maps, views, AgreementSettings(witnesses=settings.witnesses))
    checked = with_missed(banded, cameras.points.positions, views, hull)
    return _Confirmed(views, hull, guesses, checked, share_confirmed(checked, views))


def _side(photos: Sequence[Photo], medium: Medium, settings: SeededSettings) -> int:
    """px of a small view's longest side: where the blur is wider than a px of large ones, these show no more."""
    least, most = settings.longest_side
    sigma = medium.mean_sigma([photo.name for photo in photos])
    longest = max(max(photo.size) for photo in photos)
    return most if sigma <= longest / most else least


def _spread(photos: Sequence[Photo], cameras: Reconstruction, count: int) -> list[Photo]:
    """At most so many of the photos, taken from far apart: making a photo small takes as long as sweeping it."""
    poses = [cameras.poses[photo.name] for photo in photos]
    axes = np.array([pose.rotation[2] for pose in poses])
    return [photos[index] for index in spread_poses(np.array([pose.centre for pose in poses]), axes, count)]


def _maps(
    views: ViewStack, points: SparsePoints, hull: Hull | None, progress: Progress, settings: SeededSettings
) -> tuple[list[Floats], list[DepthMap]]:
    """The guess [H, W] and the map of each view that sees enough points and has neighbours."""
    references = chosen_references(views, count=settings.references)
    progress.stage("surface", len(references))
    guesses, maps = [], []
    # Guesses wait for one core at a time: whole views side by side do not.
    with ThreadPoolExecutor(compiled.threads()) as pool:
        each = pool.map(lambda view: _map(view, views, points, hull, settings), references)
        for done, found in enumerate(each, start=1):
            if progress.cancelled():
                pool.shutdown(cancel_futures=True)
                raise Cancelled("Stopped while looking for surfaces")
            if found is not None:
                guesses.append(found[0])
                maps.append(found[1])
            progress.advance(done)
    return guesses, maps


def _map(
    view: int, views: ViewStack, points: SparsePoints, hull: Hull | None, settings: SeededSettings
) -> tuple[Floats, DepthMap] | None:
    """One view's guess and map; None where it sees too few points."""
    pixels, depth = thinned(*views.depths(view, points.positions), settings.guess)
    wanted = wanted_pixels(views, view)
    if len(depth) < settings.guess.fewest_points or not wanted.any():
        return None
    near, far = np.percentile(depth, [settings.stray, 100.0 - settings.stray])
    others = neighbours_of(view, views, float(near), float(far), ChoiceSettings(neighbours=settings.neighbours))
    front = unhidden(pixels, depth, float(views.focals[view]), settings.guess)
    guess = guessed_between(pixels[front], depth[front], wanted.shape, settings.guess)
    sweep = SweepSettings(planes=settings.planes)
    return guess, swept(view, views, others, Around(guess, settings.band), wanted, hull, sweep)


def _known(points: SparsePoints, trusted: Samples, maps: Sequence[DepthMap], views: ViewStack) -> Samples:
    """The cameras' own points that no map looks through."""
    own = np.full(len(points.positions), -1, np.int32)
    free = points.chosen(compared(points.positions, own, maps, views).conflict == 0)
    spacing = float(np.median(trusted.spacing))
    count = len(free.positions)
    return Samples(free.positions, free.colours, np.ones(count, np.float32), np.full(count, spacing))
