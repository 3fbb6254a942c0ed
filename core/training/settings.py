"""What a training is asked to do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

from ..numbers import number

LossName = Literal["dgs", "paper"]
PresetName = Literal["draft", "balanced", "fine", "best"]


#: Where the step sizes come from.
_RATES = "3DGS's proportions, about three times as large: best for runs of 1000 steps; on which photos is not recorded"


@dataclass(frozen=True)
class Rates:
    """Adam's step sizes, in units of the scene (viewing distance 1) and of the raw parameters.

    The proportions are 3DGS's; all are about three times as large, which measured best for runs of
    1000 steps instead of 30,000.
    """

    means: float = number(6e-4, "viewing distance per step", "of positions, at the start", _RATES)
    means_end: float = number(6e-6, "viewing distance per step", "of positions, at the end of the run", _RATES)
    log_scales: float = number(1.5e-2, "logarithm per step", "of sizes", _RATES)
    quaternions: float = number(3e-3, "per step", "of directions", _RATES)
    opacity_logits: float = number(0.1, "logit per step", "of opacities", _RATES)
    sh: float = number(7.5e-3, "per step", "of the colour's constant part", _RATES)
    sh_rest: float = number(4e-4, "per step", "of the colour's dependence on the direction", _RATES)


@dataclass(frozen=True)
class LongRunSettings:
    """How calm a run is that has many steps."""

    steps_at_par: int = number(
        2000,
        "steps",
        "up to which step sizes are as they are set; of longer runs they fall with the root of the steps, so that what"
        " a step does at random adds up to the same",
        "held-out views after 6000 steps, all step sizes times 1, 0.58, 0.41, 0.25: 30 photos of lego (400 px, 64,000"
        " Gaussians) 29.52, 30.16, 30.22, 30.20 dB; the shelf 32.11, 32.15, 32.19 (not 0.25); after 2000 steps, times 1"
        " and 0.7: 30.10, 30.15 and 32.25, 32.07",
        "village, 8 minutes: 33.94 -> 34.99 dB",
    )


LONG_RUN = LongRunSettings()


def rates_of_long_runs(steps: int, numbers: LongRunSettings = LONG_RUN) -> float:
    """Factor in (0, 1] on all step sizes of a run of `steps` steps.

    Adam's steps have a length of their own, and follow one photo each: in long runs of large steps Gaussians wander,
    and fit the photos of the set rather than the scene.
    """
    return min(1.0, math.sqrt(numbers.steps_at_par / max(steps, 1)))


@dataclass(frozen=True)
class CalmEndSettings:
    """How a run comes to rest."""

    begin: float = number(
        0.85,
        "share of the run",
        "from which on all step sizes fall, geometrically: each step follows one photo, and the last few would remain"
        " in the twin (the mean over the last 50 to 200 steps is no better)",
        "held-out views, balanced: 33 real photos of copr 29.87 dB without, 30.13; 40 photos of lego (400 px) 33.32,"
        " 33.40; begun at 0.5 lego lost (33.21), at 0.75 33.36",
    )
    end: float = number(
        0.1,
        "factor",
        "on all step sizes at the end; 0.03 was no better",
        "the same two sets",
        "sharp shelf, 26 and 13 photos 33.56 -> 33.67, 32.27 -> 32.32; the shaken shelf from the photos alone 31.72"
        " -> 31.73; blurred by 5 px, against sharp photos: copr 28.09 -> 28.09, banana 25.73 -> 25.75",
    )


CALM_END = CalmEndSettings()


def calm_end(share: float, numbers: CalmEndSettings = CALM_END) -> float:
    """Factor in (0, 1] on all step sizes at a share in [0, 1] of the run: 1 until `begin`, then down to `end`."""
    late = max(share - numbers.begin, 0.0) / (1.0 - numbers.begin)
    return float(numbers.end**late)


#: What the factors below were chosen on; nothing else speaks for them.
_FEW_SETS = "one set for each number of photos (12, 15, 33, 67), single runs"


@dataclass(frozen=True)
class PhotoCountSettings:
    """How the number of photos changes what a training believes."""

    photos_at_par: int = number(
        36, "photos", "with so many, the noise of one photo and the smoothness are taken as they are set", _FEW_SETS
    )
    trust_power: float = number(
        3.0, "exponent", "trust in the inversion grows with this power of the photos", _FEW_SETS
    )
    least_trust: float = number(
        0.02, "factor", "with fewest photos; best with 12 and 15 photos was 0.03 to 0.1", _FEW_SETS
    )
    most_trust: float = number(
        4.0, "factor", "with many photos; best with 33 was 0.1 to 3 (no difference), with 67 1 to 5", _FEW_SETS
    )
    smoothness_power: float = number(0.5, "exponent", "smoothness falls with this power of the photos", _FEW_SETS)
    least_smooth: float = number(
        0.5, "factor", "with many photos; the best weight was 0.1 with 33 and with 67 photos", _FEW_SETS
    )
    most_smooth: float = number(
        2.0, "factor", "with few photos; the best weight was 0.1 to 0.2 with 12, 0.15 to 0.5 with 15", _FEW_SETS
    )
    start_until: float = number(
        1.5,
        "of photos_at_par",
        "from so many photos on, none of the run fits photos sharpened one by one: worth 0.05 dB with 33, it costs 0.04"
        " to 0.1 dB with 66",
        "one set with 33 photos and one with 66",
    )
    start_fall: float = number(
        2.0, "per photos_at_par", "how fast that share falls with the number of photos", "one set with 33, one with 66"
    )


PHOTO_COUNT = PhotoCountSettings()


def trust(photos: int, settings: PhotoCountSettings = PHOTO_COUNT) -> float:
    """How much to trust `photos` photos in the inversion, relative to the noise of one of them.

    Many views average noise, and distinguish what is seen from what is invented; with few, the twin's own errors
    (shape, light, coverage) pass for detail and are amplified.
    """
    share = (photos / settings.photos_at_par) ** settings.trust_power
    return float(min(max(share, settings.least_trust), settings.most_trust))


def smoothness(photos: int, settings: PhotoCountSettings = PHOTO_COUNT) -> float:
    """Factor on the total variation: the fewer photos, the more it has to say (as a prior against data)."""
    share = (settings.photos_at_par / max(photos, 1)) ** settings.smoothness_power
    return float(min(max(share, settings.least_smooth), settings.most_smooth))


def start_share(photos: int, settings: PhotoCountSettings = PHOTO_COUNT) -> float:
    """Factor on the share of the run that fits photos sharpened one by one.

    Few photos that disagree give a better first shape that way; many say more together from the first step on.
    """
    most = settings.start_until * settings.start_fall
    return float(min(max(most - settings.start_fall * photos / settings.photos_at_par, 0.0), 1.0))


@dataclass(frozen=True)
class BlurWidthSettings:
    """How the width of the blur changes how smooth a twin is kept."""

    sigma_at_par: float = number(
        5.0,
        "px of the photo",
        "standard deviation of the blur from which on low-pass and smoothness are as they are set: of finer detail"
        " a photo says nothing. Below, their variance falls with the blur's",
        "the ball and copr, blurred by 5 px",
    )
    sharp_low_pass: float = number(
        0.3,
        "px^2 of the photo",
        "where nothing is blurred: what every viewer adds",
        "3D Gaussian splatting (Kerbl et al. 2023)",
        "held-out views of sharp photos, against 2.0: copr +0.16 dB, brighton 0.00, lego (400 px) +4.6; copr blurred by"
        " 3 px, with 0.9 for 2.0: +0.05",
    )
    few_photos: int = number(
        15,
        "photos",
        "sharp ones, with which the smoothness is as it is set; with more it falls with the square of their number, as"
        " they show by themselves what is there",
        "held-out views without any smoothness: brighton (15 photos) -0.27 dB, copr (33) +0.11",
    )

    sharp_until: float = number(
        2.5,
        "px of the photo",
        "standard deviation of the blur up to which photos show how colours change with the direction",
        "held-out views with degree 3 against 1, 1000 steps: sharp photos lego +0.69 dB, banana +0.75, brighton +0.42,"
        " copr -0.05; blurred by 5 px copr -0.04, brighton -0.06, banana -0.08; between them nothing was measured",
    )
    sharp_degree: int = number(3, "degree", "of the harmonics where photos are sharp", "the same sets")


BLUR_WIDTH = BlurWidthSettings()


def harmonics_for(preset: TrainingSettings, sigma: float, numbers: BlurWidthSettings = BLUR_WIDTH) -> int:
    """Degree of the harmonics for a blur of `sigma` px (standard deviation, mean over photos and directions).

    A wide blur mixes what lies side by side: directions then explain little, and cost time in every step.
    """
    return max(preset.sh_degree, numbers.sharp_degree) if sigma <= numbers.sharp_until else preset.sh_degree


def preset_for_sharp(preset: TrainingSettings, ample: int = 0) -> TrainingSettings:
    """The preset for photos that nothing blurs but the camera's motion: more steps, and more Gaussians.

    Args:
        ample: Gaussians that the photos show amply (`training.density.budget`); 0 where that was not asked.
    """
    if preset.until is not None:
        return preset
    least = round(math.sqrt(PRESETS.sharp_steps) * preset.max_gaussians)
    most = round(PRESETS.sharp_gaussians * preset.max_gaussians)
    return replace(preset, steps=round(PRESETS.sharp_steps * preset.steps), max_gaussians=min(max(ample, least), most))


def smoothed_for(
    settings: TrainingSettings, sigma: float, photos: int, numbers: BlurWidthSettings = BLUR_WIDTH
) -> TrainingSettings:
    """The settings for so many photos with a blur of `sigma` px (standard deviation, mean over photos and directions).

    Low-pass and variation keep a twin from inventing what a blur took away. Many sharp photos show it: there both would
    only take detail away.
    """
    share = min(1.0, (sigma / numbers.sigma_at_par) ** 2)
    if share == 1.0:
        return settings
    few = min(1.0, (numbers.few_photos / max(photos, 1)) ** 2)
    low_pass = numbers.sharp_low_pass + share * (settings.low_pass - numbers.sharp_low_pass)
    return replace(
        settings, low_pass=low_pass, variation_weight=(share + (1 - share) * few) * settings.variation_weight
    )


@dataclass(frozen=True)
class PresetSettings:
    """What the other presets change of the balanced one, `TrainingSettings`."""

    draft_steps: int = number(300, "steps", "of a draft: photos to report in about half the balanced preset's time")
    draft_gaussians: int = number(25_000, "count", "a draft's budget: what so few steps can bring into shape")
    fine_steps: int = number(2000, "steps", "of the fine preset; 4000 were no better")
    fine_gaussians: int = number(56_000, "count", "the fine preset's budget: it grows with the root of the steps")
    best_steps: int = number(
        12_000, "steps", "of the best preset at most: it ends as soon as held-out photos gain no more"
    )
    best_gaussians: int = number(139_000, "count", "the best preset's budget: it grows with the root of the steps")
    sharp_steps: float = number(
        1.5,
        "times",
        "the preset's, where nothing blurs, or the camera's motion alone does: such photos go on to gain where blurred"
        " ones have shown what they can",
        "fine beside balanced, held-out views: sharp lego +1.6 dB, shelf +0.3, shaken shelf +0.6; blurred ball and copr"
        " 0.0; the factor itself is a first choice; village balanced 2.8 dB below best asked for it",
        "balanced, held-out views: room 27.20 -> 27.90 dB, plant 27.10 -> 27.34, orrery 29.75 -> 30.08,"
        " orrery-front 33.80 -> 33.85; shaken, paths learned: shelf 31.66 -> 32.04, ball 27.24 -> 27.34 (orrery,"
        " twice the steps, 30.72 -> 30.85). Defocused: orrery 27.86 -> 27.76, left as it was. Real: copr (33 photos)"
        " 29.08 -> 29.39; few photos, with dropout: banana (12) 27.52 -> 27.83, brighton (15) 18.38 -> 18.21",
    )
    sharp_gaussians: float = number(
        3.0,
        "times",
        "the preset's at most, where nothing blurs, the camera stood still and photos show so many amply; at least the"
        " root of the steps' factor, 1.22 times",
        "held-out views with 49,000, 80,000, 120,000, single runs on one thread: copr 29.21, 29.72, 30.10 dB, lego"
        " (400 px) 33.75, 34.30, 34.55; copr on two cores, 49,000 and 120,000: 43, 64 s in all",
        "held-out views, before and now: village draft 30.59 -> 32.08 dB (14, 18 s), balanced 33.81 -> 34.35 (34, 40);"
        " room 26.31 -> 26.87, 28.15 -> 28.45",
    )


PRESETS = PresetSettings()


@dataclass(frozen=True)
class TrainingSettings:
    """Choices of the optimization.

    Attributes:
        steps: iterations, one photo each.
        max_gaussians: the budget; density control never exceeds it.
        sh_degree: 0 to 3, view dependence of the colour; an ordinary run takes `harmonics_for` the blur.
        loss: 'dgs' (the blur is inverted in the residual, see `objective`), or 'paper' (MAE + SSIM on
            the degraded render alone).
        base_weight: of the paper's loss within 'dgs'; it keeps structure (SSIM) and the border.
        inverse_weight: of the inverted residual.
        inverse_width: its size, in units of the scene's contrast, from which on its gradient grows no more: photos that
            disagree (light, moved leaves, wrong depth) would otherwise leave specks. In single
            runs on one set, exact L1 (0) measured about half a dB worse, least squares 2 to 3 dB.
        noise_gain: how much more (> 1) or less the photos are trusted in the inversion than the noise of
            ONE photo says; None: `trust` of the number of photos.
        variation_weight: of the variation of the sharp render, times `smoothness` of the number of photos.
        variation_knee: the difference between neighbours, in units of the scene's contrast, above which an edge
            costs hardly more for being higher (`variation`).
        speck_weight: of the price of single specks (`specks`) where a blur is inverted, times the same `smoothness`.
        ssim_weight: of 1 - SSIM against the mean absolute error (3DGS: 0.2).
        low_pass: variance added to every projected Gaussian, in px^2 of the PHOTO's grid; as `variation_weight`, it is
            meant for blurred photos (`smoothed_for`).
        deconvolved_sigma: px, standard deviation of a blur that was undone on the photos before the training.
        backdrop: how far (in [0, 1]) the colour behind the twin is shaken from step to step; without
            it surfaces stay translucent.
        start_share: share of the run that fits photos whose blur was undone beforehand (`Objective.start_loss`), times
            `start_share` of the number of photos.
        coarse_share: share of the run on a grid of half the resolution.
        density_every, density_until: steps between two density controls, and the share of the run
            after which there are none.
        grid_step: photo px per grid px; None for what the blur allows.
        seed: of everything random.
        threads: of kernels and torch; 0 leaves them as they are.
        device: 'auto', 'cpu' or 'gpu'.
        time_limit: seconds for the optimization, None for no limit. With one, the time is the plan (`Schedule`) and
            `steps` what is expected to fit.
        until: 'plateau', or a PSNR in dB on held-out photos, at which the run may end before; None to go on.
        min_steps: neither time nor quality ends the run before so many steps.
        blur_evaluation: how the point spread is computed (`BlurOperator`), or 'splats': each projected Gaussian is
            widened by it instead of blurring the picture, which is quick and only nearly the same.
    """

    steps: int = number(1000, "steps", "of the balanced preset, one photo each; more are better until the plateau")
    max_gaussians: int = number(
        40_000, "count", "the balanced preset's budget; more resolve finer detail and take longer in every step"
    )
    sh_degree: int = number(
        1, "degree", "of the harmonics behind a blur: colours change with the direction, but not sharply; 0 to 3"
    )
    loss: LossName = "dgs"
    base_weight: float = number(
        0.3, "factor", "of the paper's loss where the blur is inverted: it keeps structure and the border"
    )
    inverse_weight: float = number(
        2.3, "factor", "of the inverted residual: what is missing in the band that the photos hold"
    )
    inverse_width: float = number(
        0.25,
        "of the scene's contrast",
        "residuals beyond count no more: photos that disagree would leave specks; exact L1 (0)"
        " was half a dB worse, least squares 2 to 3 dB",
        "one set, single runs",
    )
    noise_gain: float | None = None
    variation_weight: float = number(
        0.6, "factor", "of the sharp render's variation, against detail that no photo asks for"
    )
    variation_knee: float = number(
        0.4,
        "of the scene's contrast",
        "edges higher than this cost hardly more for being higher, so that lines keep their contrast",
    )
    speck_weight: float = number(0.2, "factor", "of the price of single specks, where a blur is inverted")
    ssim_weight: float = number(
        0.2, "share", "of 1 - SSIM against the mean absolute error", "3D Gaussian splatting (Kerbl et al. 2023)"
    )
    low_pass: float = number(
        2.0, "px^2 of the photo", "keeps Gaussians from inventing detail between the px of a blurred photo"
    )
    deconvolved_sigma: float = 0.0
    backdrop: float = number(
        0.25, "sRGB in [0, 1]", "how far the colour behind the twin is shaken; without it surfaces stay translucent"
    )
    start_share: float = number(
        0.3, "share of the run", "fits photos whose blur was undone beforehand: they show where edges lie"
    )
    coarse_share: float = number(
        0.12, "share of the run", "on a grid of half the resolution: quick, and shapes come first"
    )
    density_every: int = number(
        100, "steps", "between two density controls", "3D Gaussian splatting (Kerbl et al. 2023)"
    )
    density_until: float = number(0.6, "share of the run", "after which Gaussians are neither added nor removed")
    grid_step: int | None = None
    rates: Rates = field(default_factory=Rates)
    seed: int = 0
    threads: int = 0
    device: str = "auto"
    time_limit: float | None = None
    until: float | Literal["plateau"] | None = None
    min_steps: int = 0
    blur_evaluation: str = "auto"

    @staticmethod
    def preset(name: PresetName) -> TrainingSettings:
        """The settings behind `--preset`."""
        base = TrainingSettings()
        return {
            "draft": replace(base, steps=PRESETS.draft_steps, max_gaussians=PRESETS.draft_gaussians),
            "balanced": base,
            "fine": replace(base, steps=PRESETS.fine_steps, max_gaussians=PRESETS.fine_gaussians),
            "best": replace(
                base, steps=PRESETS.best_steps, max_gaussians=PRESETS.best_gaussians, sh_degree=3, until="plateau"
            ),
        }[name]
