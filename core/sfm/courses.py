"""Several courses through the same matches, of which the one counts that explains most of them.

COLMAP's mapper begins with a pair that 100 matches tie, and lets a photo join by 30 of the points that are there by
then. Photos that were each shaken in their own way show each other less: the pairs that are verified are right, but
have few matches each, and the mapper stops halfway or goes astray. Asked again, more leniently or from another pair,
the same matches may give every photo a place; a course takes a second, other features take many. Which course is
right, the matches say, also those of photos that found no place: a wrong model, or half a model, explains fewer.
Runs in the child process only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from ..numbers import number
from . import mapping
from .contradictions import agreement
from .job import SfmJob
from .settings import Recipe

_CHOSEN = "photos shaken by 4 to 20 px: room, plant, orrery (Cycles), copr, banana (along twins of real photos)"
_CHECKED = "likewise brighton, cans, lego, and copr by 8 to 26 px (docs/sfm.md)"


@dataclass(frozen=True)
class CourseSettings:
    """Of the courses after the first, which is the recipe's own."""

    pose_ratio: float = number(
        0.15, "share", "of a photo's matches that must agree for it to join", "taken over from the relaxed recipe"
    )
    init_inliers: int = number(40, "count", "matches of the first pair", "taken over from the relaxed recipe")
    seeds: int = number(
        3, "count", "courses from pairs that so few matches tie, each of its own seed", _CHOSEN, _CHECKED
    )


SETTINGS = CourseSettings()


def lenient(recipe: Recipe, settings: CourseSettings = SETTINGS) -> Iterator[Recipe]:
    """The recipe's other courses, where photos join by as many matches as make a pair; the first begins as it does."""
    enough = min(recipe.pose_inliers, recipe.min_inliers)
    yield replace(recipe, pose_inliers=enough)
    for seed in range(settings.seeds):
        yield replace(
            recipe,
            pose_inliers=enough,
            pose_ratio=min(recipe.pose_ratio, settings.pose_ratio),
            init_inliers=min(recipe.init_inliers, settings.init_inliers),
            seed=recipe.seed + seed,
        )


def best(
    job: SfmJob, recipe: Recipe, database: Path, images: Path, folder: Path, doubted: float, joined: Callable[[], None]
) -> Any | None:
    """The recipe's own model, if it has all photos and the pairs agree with it, or the one that explains most matches.

    Args:
        database: with verified pairs.
        folder: for the models.
        doubted: share of contradicting pairs from which on the recipe's own model is not enough.
        joined: hears of each photo that found its place.

    Returns:
        pycolmap's reconstruction; None where no course leads to one.
    """
    others = lenient(recipe) if len(job.images) < job.settings.many else islice(lenient(recipe), 1)
    most, chosen = -1.0, None
    for index, course in enumerate(dict.fromkeys([recipe, *others])):  # a relaxed recipe's own is among them
        found = mapping.map_incrementally(job, course, database, images, folder / str(index), joined)
        if not found:
            continue
        agreed = agreement(database, found[0])
        if agreed.explained > most:
            most, chosen = agreed.explained, found[0]
        if index == 0 and found[0].num_reg_images() == len(job.images) and agreed.contradicted <= doubted:
            break
    return chosen
