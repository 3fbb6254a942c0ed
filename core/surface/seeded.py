"""A first surface around points that structure from motion found: guessed between them, then sought in a narrow band.

The guess spares most of what makes planes at cameras without points slow: features, and planes over the whole range of
depths, which are only tried where the band held nothing. What nobody confirms stays where it was guessed, faint, unless
a photo looks through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..errors import Cancelled
from ..imaging.medium import Medium
from ..numbers import number
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..training.initial import depth_between
from ..views import SparsePoints
from .agreement import AgreementSettings, agreed, compared, lifted_map
from .choice import ChoiceSettings, chosen_references, neighbours_of, spread_poses
from .find import samples_of, wanted_pixels
from .hull import EMPTY, Hull, carved_hull
from .missed import with_missed
from .stack import Floats, StackSettings, ViewStack, stack_views
from .sweep import Around, DepthMap, SweepSettings, swept
from .union import Samples, merged_in

#: What the numbers below were chosen on, and checked on: docs/studies/points.md.
_CHOSEN = "copr, sharp, 400 px, and a room rendered by Cycles: drafts"
_CHECKED = "copr blurred, banana and brighton, sharp and blurred: drafts"


@dataclass(frozen=True)
class SeededSettings:
    """Of the surface around known points."""

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
    fewest_points: int = number(20, "points", "that a view must see before depths between them are guessed")
    most_points: int = number(3000, "points", "that the guess of a view is made of: more cost time and change little")
    beside: int = number(24, "points", "nearest to one in a view, which may hide it if they lie all around it")
    steepest: float = number(
        4.0, "ratio", "change of the depth's logarithm over an angle in radians: surfaces are not seen more grazingly"
    )
    stray: float = number(2.0, "percent", "of the points at each end that do not say where neighbours must look")
    step: int = number(3, "px", "between guessed samples where nothing is confirmed", _CHOSEN, _CHECKED)
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
    views = stack_views(seen, cameras, medium, StackSettings(longest_side=_side(seen, medium, settings)))
    hull = carved_hull(views)
    guesses, maps = _maps(views, cameras.points, hull, progress, settings)
    banded = agreed(maps, views, AgreementSettings(witnesses=settings.witnesses))
    checked = with_missed(banded, cameras.points.positions, views, hull)
    confirmed = sum(int((one.depth > 0).sum()) for one in checked)
    share = confirmed / max(1, sum(int(wanted_pixels(views, one.view).sum()) for one in checked))
    if share < settings.least_share or confirmed < settings.minimum_samples:
        return None
    trusted = samples_of(checked, views, settings.trusted)
    known = _known(cameras.points, trusted, checked, views)
    free = [_unseen_through(guess, checked, views, hull) for guess in _left(guesses, checked, views, settings)]
    parts = [trusted, known, samples_of(free, views, settings.guessed, even=True)]
    return SeededSurface(merged_in(parts, settings.side), share)


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
    choice = ChoiceSettings(neighbours=settings.neighbours)
    sweep = SweepSettings(planes=settings.planes)
    guesses, maps = [], []
    for done, view in enumerate(references, start=1):
        if progress.cancelled():
            raise Cancelled("Stopped while looking for surfaces")
        pixels, depth = views.depths(view, points.positions)
        wanted = wanted_pixels(views, view)
        every = max(1, len(depth) // settings.most_points)
        pixels, depth = pixels[::every], depth[::every]
        if len(depth) >= settings.fewest_points and wanted.any():
            near, far = np.percentile(depth, [settings.stray, 100.0 - settings.stray])
            others = neighbours_of(view, views, float(near), float(far), choice)
            front = unhidden(pixels, depth, float(views.focals[view]), settings)
            guess = _guess(pixels[front], depth[front], wanted.shape, settings)
            guesses.append(guess)
            maps.append(swept(view, views, others, Around(guess, settings.band), wanted, hull, sweep))
        progress.advance(done)
    return guesses, maps


def _guess(pixels: Floats, depth: Floats, shape: tuple[int, ...], settings: SeededSettings) -> Floats:
    """[H, W] depth between a view's points, at the middles of its px; of large views, of every few."""
    every = -(-max(shape) // settings.longest_side[0])
    rows, columns = np.indices([-(-side // every) for side in shape])
    middles = every * (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5)
    coarse = depth_between(pixels, depth, middles).reshape(rows.shape)
    return coarse.repeat(every, axis=0).repeat(every, axis=1)[: shape[0], : shape[1]]


def unhidden(pixels: Floats, depth: Floats, focal: float, settings: SeededSettings = SETTINGS) -> NDArray[np.bool_]:
    """[N] points of a view that nearer ones do not surround: what lies behind an object is no surface of its front.

    A nearer point hides one beside it if a surface through both would be seen at too grazing an angle.
    """
    count = min(settings.beside + 1, len(depth))
    if count < 4:
        return np.ones(len(depth), bool)
    apart, index = cKDTree(pixels).query(pixels, k=count)
    logs = np.log(depth)
    steep = logs[:, None] - logs[index] > settings.steepest * apart / focal
    steep &= apart > 0
    towards = pixels[index] - pixels[:, None]
    angles = np.sort(np.where(steep, np.arctan2(towards[..., 1], towards[..., 0]), np.inf), axis=1)
    turned = np.concatenate([angles, angles[:, :1] + 2 * np.pi], axis=1)
    many = steep.sum(axis=1)
    # (the first one again, a turn later, behind the last)
    turned[np.arange(len(depth)), many] = angles[:, 0] + 2 * np.pi
    with np.errstate(invalid="ignore"):
        gaps = np.diff(turned, axis=1)
    widest = np.where(np.arange(gaps.shape[1]) < many[:, None], gaps, 0.0).max(axis=1)
    return (many < 3) | (widest >= np.pi)


def _known(points: SparsePoints, trusted: Samples, maps: Sequence[DepthMap], views: ViewStack) -> Samples:
    """The cameras' own points that no map looks through."""
    own = np.full(len(points.positions), -1, np.int32)
    free = points.chosen(compared(points.positions, own, maps, views).conflict == 0)
    spacing = float(np.median(trusted.spacing))
    count = len(free.positions)
    return Samples(free.positions, free.colours, np.ones(count, np.float32), np.full(count, spacing))


def _left(
    guesses: Sequence[Floats], checked: Sequence[DepthMap], views: ViewStack, settings: SeededSettings
) -> list[DepthMap]:
    """The guesses at every few px where nothing was confirmed."""
    left = []
    for guess, one in zip(guesses, checked, strict=True):
        grid = np.zeros(guess.shape, bool)
        grid[:: settings.step, :: settings.step] = True
        there = wanted_pixels(views, one.view) & grid & (one.depth == 0)
        left.append(DepthMap(one.view, np.where(there, guess, 0.0).astype(np.float32), there.astype(np.float32)))
    return left


def _unseen_through(guess: DepthMap, checked: Sequence[DepthMap], views: ViewStack, hull: Hull | None) -> DepthMap:
    """Those that no confirmed surface lies behind, and no photo shows to be empty."""
    points = lifted_map(guess, views)
    others = [one for one in checked if one.view != guess.view]
    free: NDArray[np.bool_] = compared(points, np.full(len(points), -1, np.int32), others, views).conflict == 0
    if hull is not None:
        free &= hull.at(points) != EMPTY
    there = guess.depth > 0
    depth = np.zeros_like(guess.depth)
    depth[there] = guess.depth[there] * free
    return DepthMap(guess.view, depth, (depth > 0).astype(np.float32))
