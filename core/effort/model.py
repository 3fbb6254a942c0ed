"""How long each stage takes and how much memory a run needs: simple laws, set right by this machine's records.

The laws were fitted on two cores (docs/results.md); every stage is multiplied by the median of what past runs
on this machine took against it. Without records the interval is wide.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ..numbers import number
from ..photos.load import Photo
from ..sfm.settings import SfmSettings
from .records import RECORDS, PastRun, Work

T = TypeVar("T")

STAGES = ("start", "photos", "sfm", "surface", "effects", "trials", "compile", "prepare", "train", "save", "page")
#: Half-width in standard deviations of the interval that holds four of five draws of a normal distribution.
EIGHTY = 1.2816
#: A normal distribution's standard deviation over its median absolute deviation.
MAD_TO_DEVIATION = 1.4826

#: The laws' data: the developers' runs on two cores of an Intel Xeon, while the laws were written (docs/tradeoff.md).
_TWO_CORES = "the developers' own runs on two cores; which sets is not recorded"
#: Whatever machine: every law is multiplied by what this machine's own runs took against it.
_CALIBRATED = "nothing: each machine's own runs set it right"


@dataclass(frozen=True)
class Laws:
    """Seconds of each stage, and megabytes, on two cores; every machine's own runs set them right."""

    start: float = number(2.5, "s", "from the command to the first work: importing torch", _TWO_CORES, _CALIBRATED)
    photos: tuple[float, float] = number(
        (0.05, 0.03), "s, s per megapixel of the files", "decoding photos", _TWO_CORES, _CALIBRATED
    )
    no_search: float = number(0.1, "s", "reading cameras that are given", _TWO_CORES, _CALIBRATED)
    search_begin: float = number(1.0, "s", "starting the child process that finds cameras", _TWO_CORES, _CALIBRATED)
    search_few: tuple[float, float] = number(
        (4.0, 0.15),
        "s, s per photo",
        "finding cameras of a small set, of photos of `search_size`",
        _TWO_CORES,
        _CALIBRATED,
    )
    search_many: tuple[float, float] = number(
        (2.0, 0.125), "s, s per photo", "the same of a large set, which is matched once", _TWO_CORES, _CALIBRATED
    )
    search_size: float = number(0.4, "megapixels", "of the photos that the two laws above were taken from", _TWO_CORES)
    search_compiling: tuple[float, float] = number(
        (1.3, 18.0),
        "factor, s",
        "kernels are compiled on one core meanwhile: longer by this, at least so long",
        _TWO_CORES,
    )
    surface_around: tuple[float, float, int] = number(
        (0.5, 0.14, 32),
        "s, s per view, views",
        "a first surface around the cameras' points, in so many views at most",
        "copr, banana, a shelf and a room rendered by Cycles on two busy cores: half of their processor seconds",
        _CALIBRATED,
    )
    surface_whole: tuple[float, float, int] = number(
        (1.0, 0.35, 32),
        "s, s per view, views",
        "a first surface where cameras come without points: features and planes in so many views at most",
        "lego and copr on two busy cores: half of their processor seconds",
        _CALIBRATED,
    )
    surface_shrinking: float = number(0.01, "s per megapixel", "making photos small for that", "copr", _CALIBRATED)
    effects: tuple[float, float] = number(
        (0.3, 0.03),
        "s, s per photo",
        "what a run looks for that asks for nothing: exposures",
        "0.3 to 2 s of processor time for 14 to 105 photos",
        _CALIBRATED,
    )
    trials: tuple[float, float] = number(
        (30.0, 2.0),
        "s, s per photo",
        "inspecting photos and trying the effects that they call for",
        "drinks, 32 photos, and a rendered depth of field of 23, on a busy machine: within a factor of two",
        _CALIBRATED,
    )
    compile: tuple[float, float, float] = number(
        (0.05, 0.6, 14.0),
        "s",
        "loading kernels: while cameras are sought, from the cache, and compiling all of them",
        _TWO_CORES,
        _CALIBRATED,
    )
    prepare: tuple[float, float, float] = number(
        (0.3, 0.05, 1e-5),
        "s, s per megapixel, s per Gaussian",
        "undistorting photos, first Gaussians",
        _TWO_CORES,
        _CALIBRATED,
    )
    save: tuple[float, float, float] = number(
        (0.4, 0.8, 3e-6),
        "s, s per megapixel, s per Gaussian",
        "scoring and writing held-out views",
        _TWO_CORES,
        _CALIBRATED,
    )
    page: float = number(0.8, "s", "writing the report", _TWO_CORES, _CALIBRATED)
    memory: tuple[float, float, float] = number(
        (420.0, 12.0, 1.2e-3),
        "MB, MB per megapixel, MB per Gaussian",
        "libraries; photos as files, straightened and on two grids; Gaussians with their moments",
        _TWO_CORES,
        _CALIBRATED,
    )
    photos_at_once: int = number(
        24, "photos", "in memory where they are kept on disk: so many are inspected together", _TWO_CORES
    )
    search_memory: tuple[float, float] = number(
        (250.0, 16.0), "MB, MB per megapixel", "the child process that finds cameras", _TWO_CORES, _CALIBRATED
    )


@dataclass(frozen=True)
class PredictionSettings:
    """How predictions are calibrated, and how sure they claim to be."""

    window: int = number(12, "runs", "past runs that count, the latest first: older ones ran older software")
    unknown: float = number(0.5, "share", "half-width of the interval of 80 % before any run of this machine")
    least: float = number(0.06, "share", "half-width that is claimed at least, however alike past runs were")
    enough: int = number(3, "runs", "from which on a stage is called calibrated")
    of_limit: float = number(
        0.85, "share", "of a memory limit that a run comes to hold which could fill it", "1,000 photos: docs/scale.md"
    )
    scenes: int = number(4, "scenes", "whose accuracy must be measured before one of a new scene is predicted")
    busiest: float = number(0.9, "share", "a machine is never taken for busier: the division would run away")
    small_stage: float = number(0.05, "share", "of the training: shorter stages need not be calibrated")
    sampled: int = number(4, "photos", "that stand for all of them in probes, contrast and estimates")
    block: int = number(16, "px", "side of the blocks whose deviations are a photo's contrast")
    least_contrast: float = number(1e-3, "share", "of the range of values: empty photos would divide by zero")
    sure: float = number(0.1, "dB", "half-width that is claimed at least of the accuracy of a scene seen before")


LAWS_OF_TWO_CORES = Laws()
PREDICTIONS = PredictionSettings()
#: From so many photos on, cameras are found the short way.
MANY = SfmSettings().many


def _search(work: Work) -> float:
    """Cameras: features per photo, and pairs that its neighbours ask for. Kernels become ready meanwhile."""
    laws = LAWS_OF_TWO_CORES
    if not work.search:
        return laws.no_search
    fixed, each = laws.search_many if work.photos >= MANY else laws.search_few
    sought = laws.search_begin + (fixed + each * work.photos) * (work.megapixels / laws.search_size)
    longer, least = laws.search_compiling
    return sought if work.compiled else max(sought * longer, least)


def _surface(work: Work) -> float:
    """Where a training begins: around known points, or, where cameras come without any, by features and all planes."""
    laws = LAWS_OF_TWO_CORES
    (fixed, each, views) = laws.surface_around if work.points else laws.surface_whole
    return fixed + each * min(work.photos, views) + laws.surface_shrinking * work.photos * work.megapixels


def _compile(work: Work) -> float:
    searching, cached, whole = LAWS_OF_TWO_CORES.compile
    return searching if work.search else cached if work.compiled else whole


def _effects(work: Work) -> float:
    fixed, each = LAWS_OF_TWO_CORES.effects
    return fixed + each * work.photos


def _trials(work: Work) -> float:
    fixed, each = LAWS_OF_TWO_CORES.trials
    return fixed + each * work.photos


def _photos(work: Work) -> float:
    fixed, each = LAWS_OF_TWO_CORES.photos
    return fixed + each * work.files_megapixels


def _prepare(work: Work) -> float:
    fixed, pixels, gaussians = LAWS_OF_TWO_CORES.prepare
    return fixed + pixels * work.fitted * work.megapixels + gaussians * work.gaussians


def _save(work: Work) -> float:
    fixed, pixels, gaussians = LAWS_OF_TWO_CORES.save
    return fixed + pixels * work.scored * work.megapixels + gaussians * work.gaussians


LAWS: dict[str, Callable[[Work], float]] = {
    "start": lambda work: LAWS_OF_TWO_CORES.start,
    "photos": _photos,
    "sfm": _search,
    "surface": _surface,
    "effects": _effects,
    "trials": _trials,
    "compile": _compile,
    "prepare": _prepare,
    "save": _save,
    "page": lambda work: LAWS_OF_TWO_CORES.page,
}


def _memory(work: Work) -> float:
    """MB: this process and the child that finds cameras."""
    fixed, each, gaussian = LAWS_OF_TWO_CORES.memory
    pixels = work.photos * work.megapixels
    own = fixed + each * pixels + gaussian * work.gaussians
    child, child_each = LAWS_OF_TWO_CORES.search_memory
    return own + (child + child_each * pixels if work.search else 0.0)


@dataclass(frozen=True)
class Range:
    """A value with the interval that holds four of five outcomes; `calibrated`: this machine's own runs say so."""

    value: float
    low: float
    high: float
    calibrated: bool

    def plain(self, digits: int = 1) -> dict[str, float | bool]:
        """For JSON."""
        return {
            "value": round(self.value, digits),
            "low": round(self.low, digits),
            "high": round(self.high, digits),
            "calibrated": self.calibrated,
        }


def _factor(ratios: Sequence[float]) -> tuple[float, float, bool]:
    """(factor, relative half-width of 80 %, calibrated) from measured over predicted, latest last."""
    measured = [ratio for ratio in ratios if math.isfinite(ratio) and ratio > 0][-PREDICTIONS.window :]
    if not measured:
        return 1.0, PREDICTIONS.unknown, False
    middle = statistics.median(measured)
    off = [abs(ratio / middle - 1.0) for ratio in measured]
    # With few runs the spread itself is uncertain.
    spread = EIGHTY * MAD_TO_DEVIATION * statistics.median(off) + PREDICTIONS.unknown / len(measured) ** 1.5
    return middle, max(PREDICTIONS.least, spread), len(measured) >= PREDICTIONS.enough


def slowdown(busy: float | None) -> float:
    """How many times longer things take while others keep this share of the machine busy."""
    if busy is None or busy <= RECORDS.disturbed_share:
        return 1.0
    return 1.0 / (1.0 - min(busy, PREDICTIONS.busiest))


def stage_seconds(
    runs: Sequence[PastRun], work: Work, train: float, slow: float = 1.0, trials: bool = False
) -> tuple[dict[str, float], Range]:
    """Seconds by stage, and in all.

    Args:
        runs: past ones; disturbed ones count only where there is no other.
        train: seconds of training that a probe predicts, which feels what else the machine does.
        slow: `slowdown` of all other stages.
        trials: whether effects are tried, instead of looked for as every run does.
    """
    used = [run for run in runs if run.clean] or list(runs)
    seconds: dict[str, float] = {}
    variance, calibrated = 0.0, True
    for stage in STAGES:
        if stage == ("effects" if trials else "trials"):
            continue
        if stage == "train":
            base = train
            past = [run for run in used if run.train_predicted and "train" in run.seconds]
            ratios = [run.seconds["train"] / (run.train_predicted or math.nan) for run in past]
        else:
            law = LAWS[stage]
            base = law(work)
            past = [run for run in used if stage in run.seconds and _alike(stage, run.work, work)]
            ratios = [run.seconds[stage] / law(run.work) for run in past]
        factor, spread, sure = _factor(ratios)
        seconds[stage] = base * factor * (1.0 if stage == "train" else slow)
        variance += (spread * seconds[stage]) ** 2
        calibrated &= sure or base < PREDICTIONS.small_stage * train
    total = sum(seconds.values())
    half = math.sqrt(variance)
    return seconds, Range(total, max(0.0, total - half), total + half, calibrated)


def _alike(stage: str, past: Work, work: Work) -> bool:
    """Whether a past run says something about a stage."""
    if stage == "sfm":
        return past.search == work.search and (past.photos >= MANY) == (work.photos >= MANY)
    if stage == "surface":
        return past.points == work.points
    return stage != "compile" or (past.compiled == work.compiled and past.search == work.search)


def memory(runs: Sequence[PastRun], work: Work, limit: int | None = None) -> Range:
    """Peak in MB (10^6 bytes), of this process and the one that finds cameras.

    Args:
        limit: bytes that the run should hold at most, with its photos on disk; more where it cannot do with less.
    """
    ratios = [r.memory_mb / _memory(r.work) for r in runs if r.memory_mb and r.work.search == work.search]
    factor, spread, sure = _factor(ratios)
    value = factor * _memory(work)
    if limit is not None:
        least = factor * _memory(replace(work, photos=min(work.photos, LAWS_OF_TWO_CORES.photos_at_once)))
        value = max(least, min(value, PREDICTIONS.of_limit * limit / 1e6))
    return Range(value, value * (1 - spread), value * (1 + spread), sure)


def sample(things: Sequence[T]) -> list[T]:
    """A few, evenly chosen: what all of them are like."""
    return [
        things[i] for i in np.unique(np.linspace(0, len(things) - 1, min(PREDICTIONS.sampled, len(things))).astype(int))
    ]


def contrast(photos: Sequence[Photo]) -> float:
    """Root of the mean squared deviation of photos from blocks of px, in [0, 1]: what could be wrong."""
    found = []
    side, least = PREDICTIONS.block, PREDICTIONS.least_contrast
    for photo in sample(photos):
        plane = photo.pixels.mean(axis=2) / float(np.iinfo(photo.pixels.dtype).max)
        height, width = (n // side * side for n in plane.shape)
        if height and width:
            blocks = plane[:height, :width].reshape(height // side, side, width // side, side)
            found.append(float(np.mean(blocks.var(axis=(1, 3)))))
    return max(math.sqrt(statistics.mean(found)), least) if found else least


def accuracy(runs: Sequence[PastRun], preset: str, scene: str, own: float) -> Range | None:
    """PSNR on held-out photos (dB) to be expected of a preset; None where too few scenes were measured.

    What remains wrong in a picture grows with its contrast, so scenes are compared by the PSNR that they would
    have at the same contrast. A run of the very same scene and preset says it directly.
    """
    same = [r.psnr for r in runs if r.scene == scene and r.preset == preset and r.psnr is not None]
    if same:
        middle = statistics.median(same)
        spread = max(PREDICTIONS.sure, EIGHTY * statistics.pstdev(same))
        return Range(middle, middle - spread, middle + spread, True)
    by_scene: dict[str, float] = {}
    for run in runs:
        if run.preset == preset and run.psnr is not None and run.scene != scene:
            by_scene[run.scene] = run.psnr + 20.0 * math.log10(run.contrast)
    if len(by_scene) < PREDICTIONS.scenes:
        return None
    levels = list(by_scene.values())
    # The interval of one more draw: the mean's own uncertainty belongs to it.
    from scipy.stats import t  # heavy: scipy.stats

    half = float(t.ppf(0.9, len(levels) - 1)) * statistics.stdev(levels) * math.sqrt(1 + 1 / len(levels))
    value = statistics.mean(levels) - 20.0 * math.log10(own)
    return Range(value, value - half, value + half, True)
