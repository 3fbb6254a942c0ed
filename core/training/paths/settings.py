"""Numbers of the learned paths."""

from __future__ import annotations

from dataclasses import dataclass

from ...numbers import BY_DEFINITION, number

#: What some of the numbers below were chosen on, by single runs; docs/real_blur.md has the figures.
_SHAKEN = "27 photos of the rendered ball, shaken by 4 to 16 px (Cycles), one seed"
#: What the others were chosen on.
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class CameraPathSettings:
    """Numbers of the learned paths."""

    order: int = number(
        4,
        "degree",
        "of a path in each of its six axes; the prior decides how much a photo needs",
        f"{_SHAKEN}: 2 and 4",
    )
    start: float = number(2.0, "px of the grid", "length of a path at the start at least, in any direction", _FIRST)
    prior_path: float = number(
        0.016,
        "of the photo's diagonal",
        "standard deviation of half of a path's straight way: 8 px of 400 x 300",
        _FIRST,
    )
    prior_fall: float = number(2.0, "power", "of a bend's degree, by which its prior is narrower", _FIRST)
    prior_offset: float = number(1.0, "px", "standard deviation of where a path lies: how far cameras are off", _FIRST)
    photos_per_bend: int = number(
        4,
        "photos",
        "for each number of what offsets may follow the camera's place by: shakes do not, a scene that bends does",
        _FIRST,
    )
    part: float = number(0.4, "share of a step", "that is taken at each visit: the twin changes, too", _FIRST)
    longest_step: float = number(
        1.5, "px", "that a coefficient changes at a visit: the flow is that of small motions", _FIRST
    )
    looked_at: int = number(12_000, "px", "of a photo that a step looks at, evenly over it", _FIRST)
    independent: float = number(400.0, "px", "that a photo's px count as: neighbours err alike", _FIRST)
    huber: float = number(
        1.345,
        "standard deviations",
        "residuals beyond count as their size (95 % efficient on normal noise)",
        BY_DEFINITION,
    )
    depth_every: int = number(4, "visits", "of a photo, after which its depth is drawn anew", _FIRST)
    again_at: tuple[int, ...] = number(
        (5, 12, 24, 36),
        "visits",
        "of a photo, after which other paths are compared with its own: a wrong one holds itself",
        f"{_SHAKEN}: two photos keep a path that is wrong by 3 px without 5 and 12; 24 and 36 on photos shaken along a"
        " twin of copr; with 3, banana's are right sooner, but right ones of brighton give way",
    )
    again_starts: int = number(
        2, "count", "straight paths that are compared with a photo's own at a time, where the shutter rolls", _FIRST
    )
    again_steps: int = number(6, "steps", "that each of them takes before it is compared: 95 % of the way", _FIRST)
    again_turns: int = number(16, "count", "directions that are compared", _FIRST)
    again_factor: float = number(1.3, "ratio", "of one length that is compared to the next shorter one", _FIRST)
    clearly_nearer: float = number(
        2.0,
        "standard errors",
        "by which a straight path must leave less of a photo to take the place of its own",
        _FIRST,
    )
    nearer: float = number(
        0.0,
        "standard errors",
        "the same of a curved one, which explains the photo better but for its contrast, while the twin has learned to"
        " suit the own path",
        "photos shaken along twins of copr and brighton: with -1 (and a first comparison after 3 visits) 0.84 px off in"
        " the mean after 8 visits of brighton's, with 0 0.71",
    )
    again_part: int = number(
        10, "samples", "along a side of the parts of a photo whose differences count as one", _FIRST
    )
    nearest: float = number(
        0.05, "viewing distances", "no depth is less: flow grows without bound towards the camera", _FIRST
    )
    longest: float = number(
        0.25, "of the photo's diagonal", "that any coefficient may be: beyond, a photo is lost", _FIRST
    )
    coarse_share: float = number(
        0.5,
        "share of the run",
        "on the grid of half the resolution at least: paths are found there in a quarter of the time",
        f"{_SHAKEN}: 0.5 26.42 dB, 0.3 26.12",
    )
    unseen_visits: int = number(
        8, "visits", "of a photo that is held out, to find its own path on the finished twin", _FIRST
    )


SETTINGS = CameraPathSettings()
