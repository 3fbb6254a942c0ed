"""When a trial confirms an effect: the numbers of short trainings, and the verdict on what they gain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...numbers import BY_DEFINITION, number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrialSettings:
    """Numbers of the short trainings."""

    every: int = number(
        4, "photos", "of which one is judged by a pair of trainings without it, others by the next pair"
    )
    fewest_judged: int = number(5, "photos", "judged at least, by all pairs together")
    most_judged: int = number(8, "photos", "judged by a pair at most")
    pairs: int = number(2, "count", "pairs of trainings, each with a seed and judged photos of its own")
    steps: int = number(100, "steps", "of a short training")
    gaussians: int = number(2000, "count", "of a short training")
    side: int = number(
        80,
        "px",
        "along the shorter side, to which photos are averaged down: what is tried changes from photo to photo, or "
        "slowly over the frame and the depth, and shows there as well, at a price that does not grow with the photos",
    )
    points: int = number(1000, "count", "sparse points that a trial of what the sensor does starts from at most")
    shortest_path: float = number(
        1.0, "px", "of a path that counts as one: shorter ones blur less than the px", "judgement"
    )
    path_seen: float = number(1.5, "px of the trial's grid", "from which on a path that was learned is one")
    photos_moved: float = number(0.2, "share of the photos", "that learn a path at least, or none is simulated")
    path_gain: float = number(
        0.3,
        "dB",
        "that paths must gain besides being no chance: photos that are held out are aligned by theirs a little",
        "sharp photos of copr gained 0.05 and of banana 0.21, shaken ones of the rendered ball 1.7",
        "tea (real, shaken) 0.57; no other sharp set",
    )
    rival_share: float = number(
        0.33,
        "of what paths gain",
        "that a rival must gain to stand for paths that do not beat it beyond chance: a round blur of all photos, or in"
        " longer trials paths of the judging photos alone, before a twin of still ones",
        "a ball behind the engine's own glass: a round blur half; tea (really shaken): none of it",
        "sharp plants on white: judging photos alone gain 0.89 and 0.63, a sharp room 0.94; shaken sets beat that by"
        " more than chance",
    )
    focus_gain: float = number(
        0.1,
        "dB",
        "that a focus of each photo must gain besides being no chance: held-out photos have theirs, too",
        "a rendered depth of field 0.21 +- 0.05",
        "sharp photos of banana 0.04 +- 0.12 and copr 0.03 +- 0.06, forced to be tried",
    )
    focus_seen: float = number(
        0.4, "px of the trial's grid", "of blur (standard deviation) off the focus, from which on there is one"
    )
    focus_side: int = number(
        150,
        "px",
        "shorter side of the photos in a trial of a focus at least: with 200 a shelf of 480 x 320 px was tried as it"
        " is, which took four times as long and gained less (0.05 and 0.19 dB after 200 steps, foci searched for)",
    )
    path_px: float = number(4.0, "px", "that a path must still be long in a trial of it")
    path_side: int = number(200, "px", "shorter side of the photos' middles in a trial of a path")
    path_steps: int = number(
        200,
        "steps",
        "in a trial of a path: with half of them paths of 6 px are not confirmed",
        "drawn scenes with paths of 6 and 12 px, photos of 720 px",
    )
    path_gaussians: int = number(
        6000,
        "count",
        "in a trial of a path; with half of them and of the side paths of 12 px on photos of 720 px are not confirmed",
        "drawn scenes with paths of 6 and 12 px, photos of 720 px",
    )
    longer: int = number(
        3,
        "times",
        "the steps and Gaussians of a trial of a path, where short ones are not clear: what 200 steps make of a scene"
        " is too poor for a weak shake (2 to 6 px: -0.09 +- 0.06 dB on a shelf, 0.08 +- 0.06 in a village; with 600"
        " steps 2.4 +- 0.4 and 0.39 +- 0.12, sharp ones -0.27 +- 0.04), and so wrong from inside a room that shaken and"
        " sharp photos gain alike (0.19 +- 0.10 and 0.10 +- 0.13; 0.85 +- 0.21 and -0.12 +- 0.10)",
        "these rendered sets; 400 steps with 6000 Gaussians gain 0.86 +- 0.16 on the shelf, but -0.09 +- 0.11 in the"
        " village",
        "sharp photos of copr 0.06 +- 0.17, of banana 0.50 +- 0.21, of brighton 0.13 +- 0.26: none is confirmed",
    )
    longer_takes: float = number(
        4.0,
        "times",
        "the time of a short trial of a path that a longer one takes: with less left before a time limit none is begun",
        "a weakly shaken shelf, 480 x 320 px: 39 and 151 s on two busy cores",
        "a plant, 600 x 400 px: 25 and 88 s, 3.5 times",
    )
    longer_gain: float = number(
        0.35,
        "dB",
        "that paths must gain in longer trials, as `path_gain`",
        "between a sharp room with noise and drifting exposures, 0.30 +- 0.11, and a weakly shaken village, 0.39 +-"
        " 0.12 (cameras found: 0.45 +- 0.12); a sharp plant with noise and JPEG 0.20 +- 0.05",
    )
    clearly: float = number(
        2.0,
        "times",
        "what confirms after both pairs of trainings: where the first alone gains so much, the second is spared, and"
        " so are longer ones",
        "a first choice: a pair's photos do not know how far two trainings differ by chance",
    )
    chance: float = number(
        0.0228, "probability", "that chance gives as large a gain: a normal's beyond two standard errors", BY_DEFINITION
    )


SETTINGS = TrialSettings()


@dataclass(frozen=True)
class Comparison:
    """Paired differences (dB), one for each judged photo.

    Attributes:
        seen: what else speaks against it; least: gain (dB) that confirms at least.
        beside: what else speaks for it, the end of a sentence.
    """

    differences: Array
    seen: str = ""
    least: float = 0.0
    beside: str = ""

    @staticmethod
    def not_made(why: str) -> Comparison:
        """Of a trial that there was no time for."""
        return Comparison(np.zeros(0), why)

    @property
    def made(self) -> bool:
        """Whether anything was tried."""
        return len(self.differences) > 0 or not self.seen

    @property
    def mean(self) -> float:
        """Mean gain, dB."""
        return float(self.differences.mean())

    @property
    def error(self) -> float:
        """Standard error of `mean`."""
        count = len(self.differences)
        return float(self.differences.std(ddof=1) / math.sqrt(count)) if count > 1 else math.inf

    @property
    def confirms(self) -> bool:
        """Whether the gain is more than chance."""
        return self.mean > max(self.needed * self.error, self.least)

    @property
    def clear(self) -> bool:
        """Whether far more is gained than confirms."""
        wanted = max(self.needed * self.error, self.least)
        return len(self.differences) >= SETTINGS.fewest_judged and self.mean > SETTINGS.clearly * wanted

    @property
    def surely_more(self) -> bool:
        """Whether more is gained than confirms at least, whatever chance did."""
        enough = len(self.differences) >= SETTINGS.fewest_judged
        return enough and self.mean - self.needed * self.error > self.least

    @property
    def settled(self) -> bool:
        """Whether a second pair of trainings would hardly change the verdict: clear, not found, or out of reach."""
        if self.seen or self.clear:
            return True
        return len(self.differences) >= SETTINGS.fewest_judged and self.mean + self.needed * self.error < self.least

    @property
    def contradicts(self) -> bool:
        """Whether the loss is more than chance, or what was tried is not found at all."""
        return bool(self.seen) or self.mean < -self.needed * self.error

    @property
    def needed(self) -> float:
        """Standard errors that a gain must exceed: 2 with many photos, more with few (Student's t)."""
        return -float(stdtrit(max(1, len(self.differences) - 1), SETTINGS.chance))
