"""Choices of structure from motion, each with the measurement behind it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

#: Observations per photo that a hurried refinement keeps.
HURRIED_OBSERVATIONS = 120


@dataclass(frozen=True)
class Recipe:
    """One way to get from grey photos to cameras.

    Attributes:
        name, reason: for the log.
        noise_to_signal: of the Wiener filter; 0 takes the photos as they are.
        peak_threshold: SIFT's; COLMAP's default is 0.0067.
        first_octave: 0 skips SIFT's doubling of the image: blurred photos hold nothing that it
            could show, and features land closer to the truth without it (and twice as fast).
        max_features: per photo.
        guided: match again along the epipolar lines that the first matches gave. Connects sets
            whose first matches are few (7 -> 14 of 14 on a ring of photos).
        min_inliers: matches that make a pair.
        trials: of a pair's RANSAC at most; pairs without overlap would take all of COLMAP's 10,000.
        init_inliers: matches of the first pair.
        pose_inliers, pose_ratio: what a photo needs to join.
        seed: another seed takes another course through the same matches.
        image_size: longest side that features are looked for on; 0 for the photos' own.
    """

    name: str
    reason: str
    noise_to_signal: float = 3.0e-4
    peak_threshold: float = 0.02 / 3
    first_octave: int = 0
    max_features: int = 3000
    guided: bool = True
    min_inliers: int = 15
    init_inliers: int = 100
    pose_inliers: int = 30
    pose_ratio: float = 0.25
    seed: int = 0
    trials: int = 2000
    image_size: int = 0


@dataclass(frozen=True)
class RefineSettings:
    """Alignment of patches between photos after the first cameras are known.

    Attributes:
        radius, stride: patches of (2 radius + 1)^2 samples, `stride` px apart.
        steps: Gauss-Newton steps at most.
        reach: largest believed move in px.
        correlation: observations whose patches agree less are dropped.
        new_correlation, facing: what an observation needs that no feature match backs, and the
            cosine between its ray and the mean one.
        observations, observations_per_photo: at most this many are kept, longest tracks first; the
            larger limit of the two holds.
        fewest_per_photo: with fewer observations per photo than this that agree, the features' own
            model stands.
        rounds: alignment and bundle adjustment this often; 0 switches it off.
        inlier: largest reprojection error in px after the adjustment.
        iterations, tolerance: of one bundle adjustment: steps at most, and the relative gain that a
            step must bring (COLMAP asks for none and always takes all steps).
    """

    radius: int = 6
    stride: float = 3.0
    steps: int = 12
    reach: float = 4.0
    correlation: float = 0.8
    new_correlation: float = 0.85
    facing: float = 0.7
    observations: int = 12000
    observations_per_photo: int = 250
    fewest_per_photo: int = 3
    rounds: int = 2
    inlier: float = 1.0
    iterations: int = 50
    tolerance: float = 1e-6


@dataclass(frozen=True)
class SfmSettings:
    """All of it.

    Attributes:
        threads: of the child process.
        lens_model: COLMAP's name of the lens that is sought.
        one_lens: all photos of one size share a lens.
        choose_pairs_from: sets of at least this many photos do not match each with each; see
            `core.sfm.pairs`.
        many, many_features, many_partners: from so many photos on, tracks are long enough with fewer
            features per photo, matched once, with fewer partners: 76 photos of a textured table took
            242 s with the settings of a small set, and came out worse (focal 1.2 % off, not 0.2 %).
        many_sigma: with so many photos and a blur of at least this (px), features are looked for at
            half size, where the blur leaves nothing finer to be found.
        vote_features, minimum_votes, partners: features per photo that vote for pairs, votes that
            beat chance, and pairs that a photo asks for.
        time_limit: seconds after which no further recipe is begun.
        hard_limit: seconds after which the child process is ended, whatever it does.
        minimum_share: of registered photos below which the next recipe is tried.
        refine, refine_many: the patch alignment, of small and of large sets. With many photos one round leaves more
            points (1215 instead of 695 on the ball, 0.25 dB) before cameras as exact: the adjustment of all
            photos follows anyway.
    """

    threads: int = 2
    lens_model: str = "SIMPLE_RADIAL"
    one_lens: bool = True
    choose_pairs_from: int = 30
    many: int = 50
    many_features: int = 600
    many_partners: int = 6
    many_sigma: float = 4.0
    vote_features: int = 300
    minimum_votes: int = 8
    partners: int = 16
    time_limit: float = 60.0
    hard_limit: float = 300.0
    minimum_share: float = 0.75
    refine: RefineSettings = field(default_factory=RefineSettings)
    refine_many: RefineSettings = field(default_factory=lambda: RefineSettings(rounds=1, observations_per_photo=400))

    def hurried(self) -> SfmSettings:
        """For drafts: half the observations in a small set's refinement."""
        return replace(self, refine=replace(self.refine, observations_per_photo=HURRIED_OBSERVATIONS))

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


def recipes(blurred: bool) -> list[Recipe]:
    """What is tried, in order, until one is trusted."""
    if not blurred:
        return [
            Recipe("plain", "the photos as they are", 0.0, max_features=4000),
            Recipe("relaxed", "few features: lower thresholds", 0.0, 0.0015, -1, 5000, True, 10, 40, 15, 0.15),
        ]
    return [
        Recipe("filtered", "Wiener-filtered photos, matched twice"),
        Recipe(
            "relaxed filter",
            "few matches: lower thresholds, more of the fine detail",
            1e-4,
            0.004,
            0,
            4000,
            True,
            10,
            40,
            15,
            0.15,
        ),
        Recipe(
            "strong filter",
            "noise upset the matches: only the safest detail",
            1e-3,
            0.004,
            0,
            4000,
            True,
            10,
            40,
            15,
            0.15,
        ),
        Recipe("unfiltered", "the point spread function may be wrong", 0.0, 0.0015, -1, 5000, True, 10, 40, 15, 0.15),
    ]
