"""How long each stage takes and how much memory a run needs: simple laws, set right by this machine's records.

The laws were fitted on two cores (docs/results.md); every stage is multiplied by the median of what past runs
on this machine took against it. Without records the interval is wide.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..photos.load import Photo
from ..sfm.settings import SfmSettings
from .records import DISTURBED, Run, Work

T = TypeVar("T")

#: Photos that are enough to try.
VIEWS = 4
STAGES = ("start", "photos", "sfm", "compile", "prepare", "train", "save", "page")
#: Past runs that count, the latest first.
WINDOW = 12
#: Relative half-width of an 80 % interval where nothing is known, and the least that is claimed.
UNKNOWN, LEAST = 0.5, 0.06
#: Runs from which on a stage is called calibrated.
ENOUGH = 3
#: Scenes of which an accuracy must be known before one is predicted.
SCENES = 4
#: A machine is never taken for busier than this.
MOST_BUSY = 0.9
#: Half-width of 80 % in standard deviations (normal).
EIGHTY = 1.2816


#: From so many photos on, cameras are found the short way.
MANY = SfmSettings().many
#: Seconds of compiling all kernels while cameras are sought, which takes a core from them.
COMPILING = 18.0


def _search(work: Work) -> float:
    """Cameras: features per photo, and pairs that its neighbours ask for. Kernels become ready meanwhile."""
    if not work.search:
        return 0.1
    fixed, each = (2.0, 0.125) if work.photos >= MANY else (4.0, 0.15)
    sought = 1.0 + (fixed + each * work.photos) * (work.megapixels / 0.4)
    return sought if work.compiled else max(sought * 1.3, COMPILING)


LAWS: dict[str, Callable[[Work], float]] = {
    "start": lambda work: 2.5,
    "photos": lambda work: 0.05 + 0.03 * work.files_megapixels,
    "sfm": _search,
    "compile": lambda work: 0.05 if work.search else 0.6 if work.compiled else 14.0,
    "prepare": lambda work: 0.3 + 0.05 * work.fitted * work.megapixels + 1e-5 * work.gaussians,
    "save": lambda work: 0.4 + 0.8 * work.scored * work.megapixels + 3e-6 * work.gaussians,
    "page": lambda work: 0.8,
}


def _memory(work: Work) -> float:
    """MB: the libraries, photos as files, straightened and on two grids, Gaussians with moments, the child process."""
    pixels = work.photos * work.megapixels
    own = 420.0 + 12.0 * pixels + 1.2e-3 * work.gaussians
    return own + (250.0 + 16.0 * pixels if work.search else 0.0)


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
    known = [ratio for ratio in ratios if math.isfinite(ratio) and ratio > 0][-WINDOW:]
    if not known:
        return 1.0, UNKNOWN, False
    middle = statistics.median(known)
    off = [abs(ratio / middle - 1.0) for ratio in known]
    # With few runs the spread itself is hardly known.
    spread = EIGHTY * 1.4826 * statistics.median(off) + UNKNOWN / len(known) ** 1.5
    return middle, max(LEAST, spread), len(known) >= ENOUGH


def slowdown(busy: float | None) -> float:
    """How many times longer things take while others keep this share of the machine busy."""
    return 1.0 / (1.0 - min(busy or 0.0, MOST_BUSY)) if busy is not None and busy > DISTURBED else 1.0


def stage_seconds(runs: Sequence[Run], work: Work, train: float, slow: float = 1.0) -> tuple[dict[str, float], Range]:
    """Seconds by stage, and in all.

    Args:
        runs: past ones; disturbed ones count only where there is no other.
        train: seconds of training as a probe tells, which feels what else the machine does.
        slow: `slowdown` of all other stages.
    """
    used = [run for run in runs if run.clean] or list(runs)
    seconds: dict[str, float] = {}
    variance, calibrated = 0.0, True
    for stage in STAGES:
        if stage == "train":
            base = train
            told = [run for run in used if run.train_predicted and "train" in run.seconds]
            ratios = [run.seconds["train"] / (run.train_predicted or math.nan) for run in told]
        else:
            law = LAWS[stage]
            base = law(work)
            told = [run for run in used if stage in run.seconds and _alike(stage, run.work, work)]
            ratios = [run.seconds[stage] / law(run.work) for run in told]
        factor, spread, known = _factor(ratios)
        seconds[stage] = base * factor * (1.0 if stage == "train" else slow)
        variance += (spread * seconds[stage]) ** 2
        calibrated &= known or base < 0.05 * train
    total = sum(seconds.values())
    half = math.sqrt(variance)
    return seconds, Range(total, max(0.0, total - half), total + half, calibrated)


def _alike(stage: str, past: Work, work: Work) -> bool:
    """Whether a past run says something about a stage."""
    if stage == "sfm":
        return past.search == work.search and (past.photos >= MANY) == (work.photos >= MANY)
    return stage != "compile" or (past.compiled == work.compiled and past.search == work.search)


def memory(runs: Sequence[Run], work: Work) -> Range:
    """Peak in MB (10^6 bytes), of this process and the one that finds cameras."""
    ratios = [r.memory_mb / _memory(r.work) for r in runs if r.memory_mb and r.work.search == work.search]
    factor, spread, known = _factor(ratios)
    value = factor * _memory(work)
    return Range(value, value * (1 - spread), value * (1 + spread), known)


def sample(things: Sequence[T]) -> list[T]:
    """A few, evenly chosen: what all of them are like."""
    return [things[i] for i in np.unique(np.linspace(0, len(things) - 1, min(VIEWS, len(things))).astype(int))]


def contrast(photos: Sequence[Photo]) -> float:
    """Root of the mean squared deviation of photos from blocks of 16 px, in [0, 1]: what could be wrong."""
    found = []
    for photo in sample(photos):
        plane = photo.pixels.mean(axis=2) / float(np.iinfo(photo.pixels.dtype).max)
        height, width = (n // 16 * 16 for n in plane.shape)
        if height and width:
            blocks = plane[:height, :width].reshape(height // 16, 16, width // 16, 16)
            found.append(float(np.mean(blocks.var(axis=(1, 3)))))
    return max(math.sqrt(statistics.mean(found)), 1e-3) if found else 1e-3


def accuracy(runs: Sequence[Run], preset: str, scene: str, own: float) -> Range | None:
    """PSNR on held-out photos (dB) to be expected of a preset; None where too few scenes are known.

    What remains wrong in a picture grows with its contrast, so scenes are compared by the PSNR that they would
    have at the same contrast. A run of the very same scene and preset says it directly.
    """
    same = [r.psnr for r in runs if r.scene == scene and r.preset == preset and r.psnr is not None]
    if same:
        middle = statistics.median(same)
        spread = max(0.1, EIGHTY * statistics.pstdev(same))
        return Range(middle, middle - spread, middle + spread, True)
    by_scene: dict[str, float] = {}
    for run in runs:
        if run.preset == preset and run.psnr is not None and run.scene != scene:
            by_scene[run.scene] = run.psnr + 20.0 * math.log10(run.contrast)
    if len(by_scene) < SCENES:
        return None
    levels = list(by_scene.values())
    # The interval of one more draw: the mean's own uncertainty belongs to it.
    from scipy.stats import t

    half = float(t.ppf(0.9, len(levels) - 1)) * statistics.stdev(levels) * math.sqrt(1 + 1 / len(levels))
    value = statistics.mean(levels) - 20.0 * math.log10(own)
    return Range(value, value - half, value + half, True)
