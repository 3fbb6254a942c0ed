"""The ways to a twin that are compared, and what each of them trains on.

plain            Gaussian splatting of the blurred photos
wiener N vW      Wiener's filter with noise-to-signal ratio N per photo, then splatting with total variation
                 W; N 'measured' is estimated from the photos' own spectra: the choice that needs no truth
rl N vW          N iterations of Richardson-Lucy per photo, then splatting with total variation W; N 'measured'
                 is where the residual is as small as the photos' noise (`deconvolution.lucy_iterations`)
paper            the paper's loss: MAE + SSIM on the degraded render
dgs              ours
oracle           Gaussian splatting of the sharp photos
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from ...core.errors import Cancelled, DgsError
from ...core.files import read_json, write_json
from ...core.imaging.medium import Medium
from ...core.photos.load import Photo
from ...core.pipeline.fitted import split_views
from ...core.progress import Progress
from ...core.training.job import TrainingJob
from ...core.training.run import Trained, train
from ...core.training.settings import TrainingSettings
from . import deconvolution
from .dataset import Dataset

#: Weight of the total variation of all deconvolve-then-splat rows: our own method's.
VARIATION = f"v{TrainingSettings().variation_weight:g}"
WIENER_MEASURED, LUCY_MEASURED = f"wiener measured {VARIATION}", f"rl measured {VARIATION}"
#: What the best by the truth is searched among.
RATIOS, ITERATIONS = ("1e-5", "3e-5", "1e-4", "3e-4"), ("50", "100", "200")
_QUICK_RATIOS, _QUICK_ITERATIONS = ("1e-4",), ("10",)
_KINDS = ("plain", "paper", "dgs", "oracle", "wiener", "rl")
#: The rows that matter most; every seed is run.
MAIN = ("plain", "paper", "dgs", "oracle", WIENER_MEASURED, LUCY_MEASURED)
#: Chosen without the truth.
CHOSEN = (WIENER_MEASURED, LUCY_MEASURED)


def searched(quick: bool = False) -> tuple[str, ...]:
    """Rows among which the best by the truth is looked for with one seed, and the chosen ones without TV."""
    ratios, iterations = (_QUICK_RATIOS, _QUICK_ITERATIONS) if quick else (RATIOS, ITERATIONS)
    tried = (*(f"wiener {ratio} {VARIATION}" for ratio in ratios), *(f"rl {count} {VARIATION}" for count in iterations))
    return tried if quick else (*tried, "wiener measured v0", "rl measured v0")


def methods(quick: bool = False) -> list[str]:
    """All rows, in the order in which they are run."""
    return [*MAIN, *searched(quick)]


@dataclass(frozen=True)
class MethodInputs:
    """What a method trains on.

    Attributes:
        photos: registered ones.
        medium: what the training is given.
        settings: of the training.
        seconds: what the deconvolution took.
        estimate: what was estimated from the photos themselves, for the table.
    """

    photos: list[Photo]
    medium: Medium
    settings: TrainingSettings
    seconds: float = 0.0
    estimate: str = ""


class Quiet:
    """Passes on only the wish to stop: a training's own stages would hide which run it belongs to."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def stage(self, name: str, total: int | None = None) -> None: ...

    def advance(self, done: int, **figures: float) -> None: ...

    def note(self, text: str) -> None: ...

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        return self._progress.cancelled()


class MethodRunner:
    """Trains one method's twin after another, and keeps the photos deconvolved last: seeds and TV weights share them.

    Args:
        data: the set; only photos that are trained on are deconvolved.
        folder: where photos deconvolved slowly (Richardson-Lucy) are kept; None keeps none.
        threads: of Richardson-Lucy.
    """

    def __init__(self, data: Dataset, progress: Progress, folder: Path | None = None, threads: int = 1) -> None:
        self._data, self._progress, self._folder, self._threads = data, progress, folder, threads
        self._made: tuple[str, list[Photo], float, str] = ("", [], 0.0, "")
        self._iterations: tuple[int, float] | None = None

    @cached_property
    def _fitted(self) -> set[str]:
        """Names of the photos that every method trains on."""
        data = self._data
        views = split_views(data.photos, data.cameras, data.heldout, self._progress)
        return {view.name for view in views.fitted}

    def trained(self, method: str, base: TrainingSettings) -> tuple[Trained, MethodInputs, dict[str, float]]:
        """A method's twin, what it was trained on, and seconds: of the deconvolution, and wall and CPU of the rest.

        Raises:
            DgsError: there is no such method.
            Cancelled: the user stopped the training.
        """
        ready, fitted = self.inputs(method, base), self._fitted
        wall, cpu = time.perf_counter(), time.process_time()
        data, quiet = self._data, Quiet(self._progress)
        photos = [photo for photo in ready.photos if photo.name in fitted]
        views = split_views(photos, data.cameras, (), quiet).fitted
        trained = train(TrainingJob(views, [], data.cameras.points, ready.medium, ready.settings), quiet)
        if trained.steps < ready.settings.steps and self._progress.cancelled():
            raise Cancelled(f"Stopped while '{method}' was trained", "Go on with --resume")
        seconds = {"deconvolution": ready.seconds}
        return trained, ready, seconds | {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}

    def inputs(self, method: str, base: TrainingSettings) -> MethodInputs:
        """What one method is trained on.

        Raises:
            DgsError: there is no such method.
            Cancelled: the user stopped Richardson-Lucy.
        """
        photos, medium = self._data.photos, self._data.medium
        kind, *values = method.split() or [""]
        plain = replace(base, variation_weight=0.0)
        if kind not in _KINDS or len(values) != (2 if kind in ("wiener", "rl") else 0):
            raise DgsError(f"There is no method '{method}'", f"Choose among {', '.join(methods())}")
        if kind == "dgs":
            return MethodInputs(photos, medium, base)
        if kind == "paper":
            return MethodInputs(photos, medium, replace(plain, loss="paper"))
        if kind == "plain":
            return MethodInputs(photos, Medium(None), plain)
        if kind == "oracle":
            sharp = [replace(p, pixels=self._data.truth.pixels(p.name), alpha=None) for p in photos]
            return MethodInputs(sharp, Medium(None), plain)
        try:
            blur = medium.mean_sigma([photo.name for photo in photos])
            weight = float(values[1].removeprefix("v"))
            varied = replace(base, variation_weight=weight, deconvolved_sigma=blur)
            if values[0] != "measured":
                (int if kind == "rl" else float)(values[0])
        except ValueError as error:
            example = LUCY_MEASURED.replace("measured", "50") if kind == "rl" else "wiener 1e-4 v0.1"
            raise DgsError(f"There is no method '{method}'", f"Write such as '{example}'") from error
        made, seconds, estimate = self._deconvolved(kind, values[0])
        return MethodInputs(made, Medium(None), varied, seconds, estimate)

    def _deconvolved(self, kind: str, value: str) -> tuple[list[Photo], float, str]:
        key = f"{kind} {value}"
        if self._made[0] == key:
            return self._made[1:]
        began = time.perf_counter()
        photos = [photo for photo in self._data.photos if photo.name in self._fitted]
        medium, estimate = self._data.medium, ""
        if medium.psf is None or medium.psf.is_identity:
            made = photos
        elif kind == "wiener":
            made = deconvolution.wiener(photos, medium, value)
        else:
            if value == "measured":
                iterations, residual = self._measured(photos)
                last = ", the most that was tried" if iterations == deconvolution.NUMBERS.iterations[-1] else ""
                estimate = f"{iterations} iterations{last}: residual {residual:.2f} times the noise"
            else:
                iterations = int(value)
            made, seconds = self._lucy(photos, iterations)
            self._made = (key, made, seconds, estimate)
            return self._made[1:]
        self._made = (key, made, time.perf_counter() - began, estimate)
        return self._made[1:]

    def _lucy(self, photos: list[Photo], iterations: int) -> tuple[list[Photo], float]:
        """Photos, and the seconds that all of them took when they were made."""
        kept = None if self._folder is None else self._folder / f"rl_{iterations}"
        before = 0 if kept is None else len(list(kept.glob("*.npy")))
        began = time.perf_counter()
        made = deconvolution.lucy(photos, self._data.medium, iterations, self._progress, self._threads, kept)
        seconds = (time.perf_counter() - began) * len(photos) / max(1, len(photos) - before)
        file = None if kept is None else kept / "seconds.json"
        if file is not None and before >= len(photos) and file.is_file():
            seconds = float(read_json(file))
        elif file is not None:
            write_json(file, round(seconds, 1))
        return made, seconds

    def _measured(self, photos: list[Photo]) -> tuple[int, float]:
        if self._iterations is None:
            self._iterations = deconvolution.lucy_iterations(photos, self._data.medium, self._threads)
        return self._iterations
