"""Choices of structure from motion, each with the measurement behind it."""

from __future__ import annotations

from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from typing import Any

from ..numbers import number

#: Where several of these numbers were chosen.
_TABLE = "76 photos of a textured table"


@dataclass(frozen=True)
class Recipe:
    """One way to get from grey photos to cameras; the defaults are those for blurred photos.

    Attributes:
        name, reason: for the log.
        guided: match again along the epipolar lines that the first matches gave. Connects sets whose first matches
            are few (7 -> 14 of 14 on a ring of photos).
        seed: another seed takes another course through the same matches.
        every_pair: match each photo with each, in sets that are not too large for it.
        for_missing: small sets try it also where a model is trusted, but lacks photos.
    """

    name: str
    reason: str
    _: KW_ONLY
    noise_to_signal: float = number(
        3.0e-4,
        "power ratio",
        "of the Wiener filter; larger: less fine detail, less noise; 0 takes the photos as they are",
    )
    peak_threshold: float = number(
        0.02 / 3, "contrast", "SIFT's: smaller finds more and fainter features", "COLMAP's default"
    )
    first_octave: int = number(
        0,
        "octave",
        "0 skips SIFT's doubling of the image (-1): blurred photos hold nothing that it could show, and features land"
        " closer to the truth without it, twice as fast",
    )
    max_features: int = number(3000, "count", "features per photo, the strongest; more take longer to match")
    guided: bool = True
    min_inliers: int = number(15, "count", "matches that make a pair", "COLMAP's default")
    init_inliers: int = number(100, "count", "matches of the first pair", "COLMAP's default")
    pose_inliers: int = number(30, "count", "matches that a photo needs to join", "COLMAP's default")
    pose_ratio: float = number(0.25, "share", "of a photo's matches that must agree for it to join", "COLMAP's default")
    seed: int = 0
    trials: int = number(
        2000, "count", "of a pair's RANSAC at most; pairs without overlap would take all of COLMAP's 10,000"
    )
    every_pair: bool = False
    for_missing: bool = False
    image_size: int = number(0, "px", "longest side that features are looked for on; 0 for the photos' own")


@dataclass(frozen=True)
class RefineSettings:
    """Alignment of patches between photos, once the first cameras are estimated."""

    radius: int = number(6, "samples", "a patch has (2 radius + 1)^2 samples; larger: steadier, but less flat")
    stride: float = number(3.0, "px", "between the samples of a patch")
    steps: int = number(12, "count", "Gauss-Newton steps of one patch at most")
    reach: float = number(4.0, "px", "largest move of a feature that is believed")
    correlation: float = number(0.8, "correlation", "observations whose patches agree less are dropped")
    new_correlation: float = number(0.85, "correlation", "that an observation needs which no feature match backs")
    facing: float = number(
        0.7, "cosine", "between a point's ray to a photo and its mean ray; photos that see it from aside are not asked"
    )
    observations: int = number(
        12000, "count", "kept at most, longest tracks first; or as many as `observations_per_photo` allows, if more"
    )
    observations_per_photo: int = number(250, "count", "kept at most, times the photos")
    fewest_per_photo: int = number(
        3, "count", "with fewer observations per photo that agree, the features' own model stands"
    )
    rounds: int = number(2, "count", "alignment and bundle adjustment this often; 0 switches it off")
    inlier: float = number(1.0, "px", "largest reprojection error after the adjustment")
    iterations: int = number(50, "count", "steps of one bundle adjustment at most")
    tolerance: float = number(
        1e-6, "share", "gain that a step of it must bring (COLMAP asks for none and always takes all steps)"
    )


@dataclass(frozen=True)
class SfmSettings:
    """All of it.

    Attributes:
        threads: of the child process.
        lens_model: COLMAP's name of the lens that is sought.
        one_lens: all photos of one size share a lens.
        refine, refine_many: the patch alignment, of small and of large sets. With many photos one round leaves more
            points (1215 instead of 695 on the ball, 0.25 dB) before cameras as exact: the adjustment of all
            photos follows anyway.
    """

    threads: int = 2
    lens_model: str = "SIMPLE_RADIAL"
    one_lens: bool = True
    choose_pairs_from: int = number(
        30, "photos", "sets of at least this many do not match each with each; see `core.sfm.pairs`"
    )
    every_pair_below: int = number(150, "photos", "sets that match each with each where a recipe asks for it")
    unfiltered_correlation: float = number(
        0.6,
        "correlation",
        "in place of `refine.correlation` where no blur is given: photos may each be shaken in their own way, and what"
        " is left of them by a higher one are pairs that were shaken alike",
        "shaken photos (Cycles) of the ball, two contrasts, and of the shelf, three seeds: cameras off by 1.1 instead"
        " of 1.7 px, at worst 4.4 instead of 13.6 (ball), 1.2 and 3.3 instead of 1.3 and 4.3 (shelf); no other value"
        " was tried",
        "sharp photos of ball, shelf and village, two seeds: 0.22, 0.58, 0.67 instead of 0.22, 0.69, 0.60 px",
    )
    unfiltered_new_correlation: float = number(
        0.7, "correlation", "in place of `refine.new_correlation`, likewise", "chosen with it"
    )
    many: int = number(
        50,
        "photos",
        "from this many on, tracks are long enough with fewer features per photo, matched once, with fewer partners;"
        " the table took 242 s with the settings of a small set, and came out worse (focal 1.2 % off, not 0.2 %)",
        _TABLE,
    )
    many_features: int = number(600, "count", "features per photo of a large set", _TABLE)
    many_partners: int = number(6, "count", "pairs that a photo of a large set asks for", _TABLE)
    many_sigma: float = number(
        4.0,
        "px",
        "with many photos and a blur of at least this, features are looked for at half size, where the blur leaves"
        " nothing finer to be found",
    )
    vote_features: int = number(300, "count", "features per photo that vote for pairs")
    minimum_votes: int = number(8, "count", "votes that beat chance")
    partners: int = number(16, "count", "pairs that a photo of a small set asks for")
    time_limit: float = number(60.0, "s", "after which no further recipe is begun")
    hard_limit: float = number(300.0, "s", "after which the child process is ended, whatever it does")
    minimum_share: float = number(0.75, "share", "of the photos; with fewer registered the next recipe is tried")
    hurried_observations: int = number(120, "count", "observations per photo that a draft's refinement keeps")
    refine: RefineSettings = field(default_factory=RefineSettings)
    refine_many: RefineSettings = field(default_factory=lambda: RefineSettings(rounds=1, observations_per_photo=400))

    def unfiltered(self) -> RefineSettings:
        """Of a small set whose photos are taken as they are."""
        correlation, new = self.unfiltered_correlation, self.unfiltered_new_correlation
        return replace(self.refine, correlation=correlation, new_correlation=new)

    def hurried(self) -> SfmSettings:
        """For drafts: half the observations in a small set's refinement."""
        return replace(self, refine=replace(self.refine, observations_per_photo=self.hurried_observations))

    def unrefined(self) -> SfmSettings:
        """Cameras as features alone give them, to compare with."""
        return replace(self, refine=replace(self.refine, rounds=0), refine_many=replace(self.refine_many, rounds=0))

    def as_json(self) -> dict[str, Any]:
        """For the child process."""
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> SfmSettings:
        """The inverse of `as_json`."""
        nested = {name: RefineSettings(**values[name]) for name in ("refine", "refine_many")}
        return SfmSettings(**{**values, **nested})


#: For sharp photos.
PLAIN = Recipe("plain", "the photos as they are", noise_to_signal=0.0, max_features=4000)
#: Shaken photos show each other fewer and fainter features than sharp ones do, and parts of a set may hang on few of
#: them: of 205 pairs of copr and banana, shaken along their twins, one that 12 to 14 matches make is wrong, no other
FAINT = replace(
    PLAIN,
    name="faint",
    reason="photos had no place: fainter features, too",
    peak_threshold=0.0015,
    min_inliers=12,
    for_missing=True,
)
#: For blurred photos.
FILTERED = Recipe("filtered", "Wiener-filtered photos, matched twice")
#: More features from lower thresholds, and fewer matches that must agree.
RELAXED_FILTER = replace(
    FILTERED,
    name="relaxed filter",
    reason="few matches: lower thresholds, more of the fine detail",
    noise_to_signal=1e-4,
    peak_threshold=0.004,
    max_features=4000,
    min_inliers=10,
    init_inliers=40,
    pose_inliers=15,
    pose_ratio=0.15,
)
STRONG_FILTER = replace(
    RELAXED_FILTER, name="strong filter", reason="noise upset the matches: only the safest detail", noise_to_signal=1e-3
)
#: Also at twice the size, where sharp photos hold small features.
UNFILTERED = replace(
    RELAXED_FILTER,
    name="unfiltered",
    reason="the point spread function may be wrong",
    noise_to_signal=0.0,
    peak_threshold=0.0015,
    first_octave=-1,
    max_features=5000,
)
THOROUGH = replace(
    PLAIN,
    name="thorough",
    reason="cameras were doubted, or photos had no place: features also at twice the size, each photo with each",
    first_octave=-1,
    every_pair=True,
    for_missing=True,
)
RELAXED = replace(UNFILTERED, name="relaxed", reason="few features: lower thresholds")


def recipes(blurred: bool) -> list[Recipe]:
    """What is tried, in order, until one is trusted."""
    return [FILTERED, RELAXED_FILTER, STRONG_FILTER, UNFILTERED] if blurred else [PLAIN, FAINT, THOROUGH, RELAXED]
