"""The parts of a run that restores photos, and how far each of them is."""

from __future__ import annotations

from dataclasses import dataclass

from ...numbers import number

#: What the numbers below were chosen on.
_TRUE_PATHS = "photos shaken along twins of copr and banana by 4 to 20 px, true cameras and paths, one run each"
#: What the whole course was checked on.
_CHECKED = (
    "brighton 24.10 -> 24.28 dB, a shaken Cycles room 26.08 -> 26.31 (depths mended at once), tea nothing; shaken by"
    " Cycles, nothing given: shelf 31.70 -> 31.82, plant 34.83 -> 34.99, orrery 30.42 -> 30.48"
)


@dataclass(frozen=True)
class CourseSettings:
    """When photos are restored in a run, and for how long."""

    begin: float = number(
        0.6,
        "share of the run",
        "before which photos are followed along their paths, as a run of its own that comes to rest",
        f"{_TRUE_PATHS}, held-out views of copr after 750 and 400 such steps: 31.57, 31.36 dB",
        _CHECKED,
    )
    end: float = number(
        0.85,
        "share of the run",
        "from which on they are followed along their paths again, as in every run's calm end: what was restored wrongly"
        " is mended (0.14 and 0.17 dB)",
        _TRUE_PATHS,
        _CHECKED,
    )
    photos_at_a_step: int = number(
        4, "photos", "restored ones that a step fits: about as many as take the time of one along its path"
    )
    fewest_visits: float = number(
        12.0, "visits", "of each photo before `begin`: with fewer, paths are not known yet", "a first choice"
    )
    most_px: float = number(
        5e7, "px", "of the photos together that are restored: as many are kept in memory, 300 MB", "a first choice"
    )


COURSE = CourseSettings()


@dataclass(frozen=True)
class Part:
    """A part of a run.

    Attributes:
        share: of what rates, grids and density control follow in this part, in [0, 1].
        restored: whether new Gaussians are fitted to restored photos.
    """

    share: float
    restored: bool = False


def part_of(share: float, restores: bool, numbers: CourseSettings = COURSE) -> Part:
    """Where a run is at a share in [0, 1] of it; `restores`: whether it restores photos."""
    if not restores or share >= numbers.end:
        return Part(share)
    if share < numbers.begin:
        return Part(share / numbers.begin)
    return Part((share - numbers.begin) / (numbers.end - numbers.begin), restored=True)


def edges(coarse: float, restores: bool, numbers: CourseSettings = COURSE) -> list[float]:
    """Shares in (0, 1) of a run at which its steps change; `coarse`: share of the first part on the coarse grid."""
    return [coarse * numbers.begin, numbers.begin, numbers.end] if restores else [coarse]
