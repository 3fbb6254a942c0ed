"""Trains and measures every point with every seed; rows are kept on disk and taken up again."""

from __future__ import annotations

import csv
import io
import json
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ...core.devices import choose_device
from ...core.effort.clock import OthersLoad
from ...core.errors import Cancelled, DgsError
from ...core.evaluation.metrics import psnr
from ...core.files import make_folder, write_json, write_text
from ...core.gaussians import Gaussians
from ...core.imaging.medium import Medium
from ...core.machine import machine, use_machine
from ...core.numbers import number
from ...core.pipeline.cameras import CameraSearch, FoundCameras
from ...core.pipeline.effects.ablation import TrialTerms
from ...core.pipeline.fitted import split_views
from ...core.pipeline.refinement import RefinementJob, refine
from ...core.pipeline.simulated import simulate
from ...core.pipeline.views import Viewer, to_pixels
from ...core.progress import Progress
from ...core.sfm.settings import SfmSettings
from ...core.training.job import TrainingJob
from ...core.training.run import Trained, train
from ...core.training.scale import scene_scale
from ...core.training.settings import TrainingSettings
from ...core.training.trainer import Trainer
from ...core.twin.folder import TwinFolder
from ..comparison.dataset import Dataset, kept_cameras, load_dataset
from ..comparison.measure import Measure
from ..comparison.methods import Quiet
from ..comparison.runs import read_row, run_key
from ..comparison.settings import Elsewhere
from .chart import draw
from .front import points
from .knobs import GROUPS, Knob, base_settings, knobs
from .page import write_page
from .settings import TradeoffSettings


@dataclass(frozen=True)
class TradeoffNumbers:
    """Of the accuracy over time of one run."""

    evaluated_at: tuple[float, ...] = number(
        (0.06, 0.12, 0.2, 0.35, 0.5, 0.7, 0.85),
        "share of the steps",
        "evaluations during a run, closer where the accuracy rises fast; the end comes on top",
    )
    evaluated_views: int = number(3, "count", "held-out views of an evaluation; its own time is taken out")


NUMBERS = TradeoffNumbers()
#: Columns of the table, in order.
COLUMNS = (
    "group",
    "knob",
    "seeds",
    "seconds",
    "seconds_spread",
    "psnr",
    "psnr_spread",
    "ssim",
    "line_error",
    "time_to_target",
    "best_in_60",
    "gaussians",
    "steps",
    "front",
    "disturbed",
    "skipped",
)


def measure_tradeoff(
    settings: TradeoffSettings, progress: Progress, elsewhere: Elsewhere | None = None
) -> dict[str, Any]:
    """Measures all points and writes tradeoff.json, .csv, .svg, .png and .html to `settings.out`.

    Where single rows are asked for, only they are written and returned.

    Args:
        elsewhere: has rows made by others.

    Raises:
        DgsError: the set cannot be used.
        Cancelled: the user asked to stop; finished rows stay, and --resume goes on from them.
    """
    unknown = [group for group in settings.only if group not in GROUPS]
    if unknown:
        raise DgsError(f"There is no knob '{unknown[0]}'", f"Choose among {', '.join(GROUPS)}")
    threads, device = use_machine(settings.threads), choose_device(settings.device)
    make_folder(settings.out)
    data = load_dataset(settings, threads, progress)
    base = replace(base_settings(settings.quick), threads=threads, device=device)
    if elsewhere is not None:
        elsewhere(_missing(settings, data, base))
        settings = replace(settings, resume=True)
    rows = _rows(settings, data, base, progress)
    if settings.rows:
        return {"rows": rows}
    found, target = points(rows, settings.target)
    content = {
        "set": data.name,
        "photos": data.given,
        "registered": len(data.photos),
        "size": list(data.photos[0].size),
        "psf": data.psf,
        "cameras": settings.cameras,
        "quick": settings.quick,
        "seeds": settings.seeds,
        "target": target,
        "heldout": len(data.heldout),
        "machine": machine(threads, device),
        "points": found,
        "rows": rows,
    }
    write_json(settings.out / "tradeoff.json", content)
    write_text(settings.out / "tradeoff.csv", table(found))
    draw(found, target, data.name, settings.out / "tradeoff.svg", settings.out / "tradeoff.png")
    write_page(settings.out / "tradeoff.html", content, (settings.out / "tradeoff.svg").read_text("utf-8"))
    return content


def table(found: list[dict[str, Any]]) -> str:
    """The points as CSV; empty where something was not measured."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for point in found:
        writer.writerow({k: round(v, 4) if isinstance(v, float) else v for k, v in point.items() if v is not None})
    return text.getvalue()


def _wanted(settings: TradeoffSettings) -> list[tuple[Knob, int]]:
    """Seed by seed: whoever stops early has all knobs once, not some of them three times.

    Raises:
        DgsError: a row was asked for that is not in this study.
    """
    every = [(knob, seed) for seed in range(settings.seeds) for knob in knobs(settings.quick, settings.only)]
    unknown = set(settings.rows) - {_name(*row) for row in every}
    if unknown:
        raise DgsError(f"There is no row '{min(unknown)}'", f"Rows are called KNOB-SEED, such as {_name(*every[0])}")
    return [row for row in every if not settings.rows or _name(*row) in settings.rows]


def _name(knob: Knob, seed: int) -> str:
    return f"{knob.name}-{seed}"


def _key(settings: TradeoffSettings, data: Dataset, base: TrainingSettings, knob: Knob) -> str:
    facts = {name: value for name, value in asdict(knob).items() if name != "changes"}
    return run_key(settings, data, knob.settings(base)) + json.dumps(facts, sort_keys=True)


def _missing(settings: TradeoffSettings, data: Dataset, base: TrainingSettings) -> list[str]:
    """Names of the rows that are not on disk, or belong to other settings."""
    return [
        _name(knob, seed)
        for knob, seed in _wanted(settings)
        if not settings.resume
        or read_row(settings.out / "rows" / f"{_name(knob, seed)}.json", _key(settings, data, base, knob)) is None
    ]


def _rows(
    settings: TradeoffSettings, data: Dataset, base: TrainingSettings, progress: Progress
) -> list[dict[str, Any]]:
    sets = _Sets(settings, data, base.threads, progress)
    todo = _wanted(settings)
    progress.stage("tradeoff", len(todo))
    rows = []
    for run, (knob, seed) in enumerate(todo, start=1):
        file = settings.out / "rows" / f"{_name(knob, seed)}.json"
        key = _key(settings, data, base, knob)
        row = read_row(file, key) if settings.resume else None
        if row is None:
            if progress.cancelled():
                raise Cancelled(f"Stopped after {run - 1} of {len(todo)} runs", "Go on with --resume")
            row = {"key": key, "knob": knob.label, "group": knob.group, "seed": seed}
            try:
                row |= one_run(knob, replace(knob.settings(base), seed=seed), sets, progress)
            except Cancelled:
                raise
            except DgsError as error:  # a knob that this set does not have
                row |= {"skipped": " ".join(str(error).split())}
                progress.note(f"{knob.label}: {row['skipped']}")
            write_json(file, row)
        rows.append(row)
        if not row.get("skipped"):
            progress.advance(run, psnr=row["heldout"]["psnr"], seconds=row["seconds"]["total"])
    return rows


def one_run(knob: Knob, settings: TrainingSettings, sets: _Sets, progress: Progress) -> dict[str, Any]:
    """Trains one twin and measures it. Scoring and evaluations do not count; cameras, effects and views do.

    Raises:
        Cancelled: the user stopped the training.
        DgsError: the set has no such knob.
    """
    data, measure, searching = sets.of(knob)
    others = OthersLoad()
    began, processor = time.perf_counter(), time.process_time()
    medium = data.medium if knob.medium else Medium(None, data.medium.blur_space)
    views = split_views(data.photos, data.cameras, measure.held, Quiet(progress))
    effects = simulate(knob.effects, data.photos, data.cameras, views, medium, TrialTerms(settings), Quiet(progress))
    evaluations = _Evaluations(
        data,
        measure.held[:: max(1, len(measure.held) // NUMBERS.evaluated_views)][: NUMBERS.evaluated_views],
        began,
        settings.steps,
    )
    job = TrainingJob(effects.fitted, [], data.cameras.points, effects.medium, settings, effects.chosen.formation)
    trained = train(job, Quiet(progress), watch=evaluations)
    wall = time.perf_counter() - began - evaluations.away
    processor = time.process_time() - processor - evaluations.away_processor
    if trained.steps < settings.steps and progress.cancelled():
        raise Cancelled(f"Stopped while '{knob.label}' was trained", "Go on with --resume")
    if knob.bits == 16:
        trained.gaussians = Gaussians(**{name: t.half().float() for name, t in trained.gaussians.named()})
    found = measure.twin(trained, None)
    end = found["heldout"]["psnr"]
    # Evaluations see a few views only; at the end all are seen, and the curve is moved by the difference.
    offset = end - evaluations.psnr(trained.gaussians, trained)
    curve = [[round(searching + seconds, 2), round(value + offset, 3)] for seconds, value in evaluations.curve]
    total = searching + wall
    return {
        "seconds": {
            "cameras": round(searching, 2),
            "training": round(wall, 2),
            "total": round(total, 2),
            "processor": round(processor, 2),
        },
        "gaussians": len(trained.gaussians),
        "steps": trained.steps,
        "curve": [*curve, [round(total, 2), end]],
        "disturbed": others.share(),
        **found,
    }


class _Evaluations:
    """The accuracy on a few held-out views while a training runs; its own time is taken out."""

    def __init__(self, data: Dataset, names: list[str], began: float, steps: int) -> None:
        now, processor = time.perf_counter(), time.process_time()
        self._data, self._began = data, began
        self._due = sorted({max(1, round(share * steps)) for share in NUMBERS.evaluated_at})
        self._truth = {name: _unit(data.truth.pixels(name)) for name in names}
        self._scale = scene_scale(list(data.cameras.cameras().values()), data.cameras.points)
        self.curve: list[tuple[float, float]] = []
        self.away, self.away_processor = time.perf_counter() - now, time.process_time() - processor

    def __call__(self, trainer: Trainer) -> None:
        """After an iteration."""
        if trainer.step not in self._due:
            return
        now, processor = time.perf_counter(), time.process_time()
        behind = trainer.background.cpu()
        colour = (float(behind[0]), float(behind[1]), float(behind[2]))
        self.curve.append((now - self._began - self.away, self._psnr(trainer.result(), colour)))
        self.away += time.perf_counter() - now
        self.away_processor += time.process_time() - processor

    def psnr(self, gaussians: Gaussians, trained: Trained) -> float:
        """Of the finished twin, on the same views."""
        return self._psnr(gaussians, trained.background)

    def _psnr(self, gaussians: Gaussians, background: tuple[float, float, float]) -> float:
        viewer = Viewer(gaussians, self._scale, "cpu", background=background)
        cameras = self._data.cameras
        found = []
        for name, truth in self._truth.items():
            twin = _unit(to_pixels(viewer.sharp(cameras.lenses[name], cameras.poses[name])))
            found.append(psnr(twin, truth))
        return float(np.mean(found))


class _Sets:
    """The set with cameras found in different ways, each once."""

    def __init__(self, settings: TradeoffSettings, data: Dataset, threads: int, progress: Progress) -> None:
        self._settings, self._data, self._threads, self._progress = settings, data, threads, progress
        self._found: dict[str, tuple[Dataset, Measure, float]] = {}

    def of(self, knob: Knob) -> tuple[Dataset, Measure, float]:
        """The set, what measures its twins, and the seconds that finding the cameras took.

        Raises:
            DgsError: the cameras are given, so that there is nothing to be found differently.
        """
        if knob.cameras == "refined" and "refined" not in self._found:
            self._found["refined"] = self._refined()
        if knob.cameras not in self._found:
            data, seconds = self._data, 0.0
            if self._settings.cameras == "found":
                data, seconds = self._searched(knob)
            elif knob.cameras == "unrefined":
                raise DgsError("The cameras are given and were not refined here", "Use --cameras found")
            self._found[knob.cameras] = data, Measure(data, only_heldout=True), seconds
        return self._found[knob.cameras]

    def _searched(self, knob: Knob) -> tuple[Dataset, float]:
        """The set with cameras that are searched for as the knob says, and the seconds that this took.

        Those that the set was loaded with count as searched for as usual.
        """
        usual = SfmSettings(threads=self._threads)
        settings = {"hurried": usual.hurried(), "unrefined": usual.unrefined()}.get(knob.cameras, usual)
        out = self._settings.out
        folder = TwinFolder(out if knob.cameras == "usual" else out / f"cameras-{knob.cameras}")
        search = CameraSearch(settings, resume=knob.cameras == "usual" or self._settings.resume)
        data = self._data
        cameras, seconds = kept_cameras(folder, data.photos, data.medium, search, self._progress)
        photos = [photo for photo in data.photos if photo.name in cameras.poses]
        return replace(data, cameras=cameras, photos=photos), seconds

    def _refined(self) -> tuple[Dataset, Measure, float]:
        """The usual cameras, moved by the loss; held-out photos judge whether they are kept."""
        data, _, seconds = self.of(Knob("cameras", "usual"))
        began = time.perf_counter()
        chosen = replace(base_settings(self._settings.quick), threads=self._threads)
        job = RefinementJob(data.photos, data.heldout, data.medium, chosen, None)
        refined = refine(FoundCameras(data.cameras, "sfm"), job, Quiet(self._progress))
        moved = replace(data, cameras=refined.reconstruction)
        return moved, Measure(moved, only_heldout=True), seconds + time.perf_counter() - began


def _unit(pixels: Any) -> Any:
    return pixels / float(np.iinfo(pixels.dtype).max)
