"""What the optimizer is told to do."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

LossName = Literal["dgs", "paper"]
PresetName = Literal["draft", "balanced", "fine"]


@dataclass(frozen=True)
class Rates:
    """Adam's step sizes, in units of the scene (viewing distance 1) and of the raw parameters.

    The proportions are 3DGS's; all are about three times as large, which measured best for runs of
    1000 steps instead of 30,000.
    """

    means: float = 6e-4
    means_end: float = 6e-6
    log_scales: float = 1.5e-2
    quaternions: float = 3e-3
    opacity_logits: float = 0.1
    sh: float = 7.5e-3
    sh_rest: float = 4e-4


#: With so many photos, the noise of one photo and the smoothness are taken as they are set.
PHOTOS_AT_PAR = 36
LEAST_TRUST, MOST_TRUST = 0.02, 4.0
LEAST_SMOOTH, MOST_SMOOTH = 0.5, 2.0


def trust(photos: int) -> float:
    """How much to trust `photos` photos in the inversion, relative to the noise of one of them.

    Many views average noise, and tell what is seen from what is invented; with few, the twin's own errors
    (shape, light, coverage) pass for detail and are amplified. Measured best: 0.03 to 0.1 with 12 and 15
    photos, 0.1 to 3 (no difference) with 33, 1 to 5 with 67 (one set each, single runs).
    """
    return float(min(max((photos / PHOTOS_AT_PAR) ** 3, LEAST_TRUST), MOST_TRUST))


def smoothness(photos: int) -> float:
    """Factor on the total variation: the fewer photos, the more it has to say (as a prior against data).

    Measured best: a weight of 0.1 to 0.2 with 12 photos, 0.15 to 0.5 with 15, 0.1 with 33 and with 67.
    """
    return float(min(max((PHOTOS_AT_PAR / max(photos, 1)) ** 0.5, LEAST_SMOOTH), MOST_SMOOTH))


def start_share(photos: int) -> float:
    """Factor on the share of the run that fits photos sharpened one by one.

    Few photos that disagree give a better first shape that way; many tell more together from the first step
    on. Measured: with 33 photos worth 0.05 dB, with 66 it costs 0.04 to 0.1 (one set each).
    """
    return float(min(max(3.0 - 2.0 * photos / PHOTOS_AT_PAR, 0.0), 1.0))


@dataclass(frozen=True)
class TrainingSettings:
    """Choices of the optimization.

    Attributes:
        steps: iterations, one photo each.
        max_gaussians: the budget; density control never exceeds it.
        sh_degree: 0 to 3, view dependence of the colour.
        loss: 'dgs' (the blur is inverted in the residual, see `objective`), or 'paper' (MAE + SSIM on
            the degraded render alone).
        base_weight: of the paper's loss within 'dgs'; it keeps structure (SSIM) and the border.
        inverse_weight: of the inverted residual.
        inverse_width: its size, in units of the scene's contrast, from which on it pulls no harder: photos that
            disagree (light, moved leaves, wrong depth) would otherwise leave specks. In single
            runs on one set, exact L1 (0) measured about half a dB worse, least squares 2 to 3 dB.
        noise_gain: how much more (> 1) or less the photos are trusted in the inversion than the noise of
            ONE photo says; None: `trust` of the number of photos.
        variation_weight: of the variation of the sharp render, times `smoothness` of the number of photos.
        variation_knee: the difference between neighbours, in units of the scene's contrast, above which an edge
            costs hardly more for being higher (`variation`).
        speck_weight: of the price of single specks (`specks`) where a blur is inverted, times the same `smoothness`.
        ssim_weight: of 1 - SSIM against the mean absolute error (3DGS: 0.2).
        low_pass: variance added to every projected Gaussian, in px^2 of the PHOTO's grid.
        backdrop: how far (in [0, 1]) the colour behind the twin is shaken from step to step; without
            it surfaces stay translucent.
        start_share: share of the run that fits photos whose blur was undone beforehand (`Objective.start`), times
            `start_share` of the number of photos.
        coarse_share: share of the run on a grid of half the resolution.
        density_every, density_until: steps between two density controls, and the share of the run
            after which there are none.
        grid_step: photo px per grid px; None for what the blur allows.
        seed: of everything random.
        threads: of kernels and torch; 0 leaves them as they are.
        device: 'auto', 'cpu' or 'cuda'.
        time_limit: seconds for the optimization, None for no limit. With one, the time is the plan (`Schedule`) and
            `steps` what is expected to fit.
        until: 'plateau', or a PSNR in dB on held-out photos, at which the run may end before; None to go on.
        min_steps: neither time nor quality ends the run before so many steps.
        blur_evaluation: how the point spread is computed (`BlurOperator`), or 'splats': each projected Gaussian is
            widened by it instead of blurring the picture, which is quick and only nearly the same.
    """

    steps: int = 1000
    max_gaussians: int = 40_000
    sh_degree: int = 1
    loss: LossName = "dgs"
    base_weight: float = 0.3
    inverse_weight: float = 2.3
    inverse_width: float = 0.25
    noise_gain: float | None = None
    variation_weight: float = 0.6
    variation_knee: float = 0.4
    speck_weight: float = 0.2
    ssim_weight: float = 0.2
    low_pass: float = 2.0
    backdrop: float = 0.25
    start_share: float = 0.3
    coarse_share: float = 0.12
    density_every: int = 100
    density_until: float = 0.6
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
            "draft": replace(base, steps=300, max_gaussians=25_000),
            "balanced": base,
            "fine": replace(base, steps=2000, max_gaussians=56_000),
        }[name]
