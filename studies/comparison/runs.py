"""Trains and measures every method with every seed; rows are kept on disk and taken up again."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ...core.errors import Cancelled, DgsError
from ...core.evaluation.metrics import low_passed_truth_psnr
from ...core.files import make_folder, write_json
from ...core.formats.ply import write_ply
from ...core.machine import choose_device, machine, use_threads
from ...core.photos.undistort import undistorted_views
from ...core.pipeline.heldout import mean_of
from ...core.progress import Progress
from ...core.training.grid import grid_step
from ...core.training.run import train
from ...core.training.settings import TrainingSettings
from . import table
from .dataset import Dataset, load_dataset
from .measure import Measure
from .methods import CHOSEN, LUCY_MEASURED, MAIN, VARIATION, Kitchen, searched
from .pictures import write_pictures
from .settings import CompareSettings

#: Cycles/px up to which the low-passed truths know everything.
CUTOFFS = (0.11, 0.125)
#: What --quick spends on each twin.
QUICK_STEPS, QUICK_GAUSSIANS = 120, 4000
#: Folder of photos that took long to deconvolve, until the comparison is finished.
DECONVOLVED = "deconvolved"


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


def compare(settings: CompareSettings, progress: Progress) -> dict[str, Any]:
    """Runs all methods, writes table (JSON, Markdown) and pictures to `settings.out`, returns the table.

    Raises:
        DgsError: the set or a method cannot be used.
        Cancelled: the user asked to stop; finished rows stay, and --resume goes on from them.
    """
    threads = use_threads(settings.threads)
    device = choose_device(settings.device)
    make_folder(settings.out)
    data = load_dataset(settings, threads, progress)
    base = training_settings(settings, data, threads, device)
    if data.reference is None:
        progress.note("The set has no cameras of its own: no pose errors and no line widths")
    measure = Measure(data)
    rows = _rows(settings, data, measure, base, progress)
    facts = _facts(settings, data, measure, base, threads, device)
    content = {"facts": facts, "methods": table.summarised(rows, CHOSEN), "rows": rows}
    write_json(settings.out / "compare.json", content)
    content["pictures"] = write_pictures(settings.out, data, measure, content, progress)
    write_json(settings.out / "pictures.json", content["pictures"])
    table.write(settings.out / "compare.md", content)
    shutil.rmtree(settings.out / DECONVOLVED, ignore_errors=True)
    return content


def _rows(
    settings: CompareSettings, data: Dataset, measure: Measure, base: TrainingSettings, progress: Progress
) -> list[dict[str, Any]]:
    """The main methods with all seeds; a search with one; and the best that it finds with all seeds again."""
    if settings.only:
        return run_all(settings.only, settings, data, measure, base, progress)
    rows = run_all(MAIN, settings, data, measure, base, progress)
    told = next((row["told"] for row in rows if row["method"] == LUCY_MEASURED), "")
    search = [method for method in searched(settings.quick) if not told.startswith(f"{_count(method)} iterations")]
    rows += run_all(search, settings, data, measure, base, progress, seeds=range(1))
    each = table.summarised(rows, CHOSEN)["each"]
    alike = {name: entry for name, entry in each.items() if name.endswith(VARIATION)}
    best = [name for kind in ("wiener", "rl") if (name := table.best(alike, kind)) in search]
    return rows + run_all(best, settings, data, measure, base, progress, seeds=range(1, settings.seeds))


def _count(method: str) -> str:
    """Of Richardson-Lucy's iterations; a dash for other methods and for those without TV."""
    kind, *values = method.split()
    return values[0] if kind == "rl" and values[-1] == VARIATION else "-"


def training_settings(settings: CompareSettings, data: Dataset, threads: int, device: str) -> TrainingSettings:
    """What all methods share: the product's own budget unless asked otherwise, and the grid the blur allows."""
    usual = TrainingSettings()
    steps, most = (QUICK_STEPS, QUICK_GAUSSIANS) if settings.quick else (usual.steps, usual.max_gaussians)
    return replace(
        usual,
        grid_step=grid_step(data.medium, *data.photos[0].size),
        threads=threads,
        device=device,
        steps=settings.steps or steps,
        max_gaussians=settings.max_gaussians or most,
    )


def run_all(
    wanted: Sequence[str],
    settings: CompareSettings,
    data: Dataset,
    measure: Measure,
    base: TrainingSettings,
    progress: Progress,
    folder: str = "rows",
    seeds: Sequence[int] | None = None,
) -> list[dict[str, Any]]:
    """One row for each method and seed; those on disk are read if the settings are the same."""
    key = run_key(settings, data, base)
    main = folder == "rows"
    kitchen = Kitchen(data, progress, settings.out / DECONVOLVED / key if main else None, base.threads)
    rows = []
    todo = [(method, seed) for method in wanted for seed in (range(settings.seeds) if seeds is None else seeds)]
    if not todo:
        return []
    if main:
        _prepare(todo, kitchen, settings, base, folder, key)
    progress.stage("compare", len(todo))
    for number, (method, seed) in enumerate(todo, start=1):
        file = settings.out / folder / f"{method.replace(' ', '_')}-{seed}.json"
        row = _kept(file, key) if settings.resume else None
        twin = settings.out / "twins" / f"{method.replace(' ', '_')}.ply" if seed == 0 and main else None
        if row is None or not (twin is None or twin.is_file()):
            if progress.cancelled():
                raise Cancelled(f"Stopped after {number - 1} of {len(todo)} runs", "Go on with --resume")
            renders = settings.out / "renders" / method.replace(" ", "_") if twin is not None else None
            row = {"key": key, **one_run(method, seed, data, measure, kitchen, base, progress, renders, twin)}
            write_json(file, row)
        rows.append(row)
        progress.advance(number, psnr=row["heldout"]["psnr"] or float("nan"))
    return rows


def one_run(
    method: str,
    seed: int,
    data: Dataset,
    measure: Measure,
    kitchen: Kitchen,
    base: TrainingSettings,
    progress: Progress,
    renders: Path | None = None,
    twin: Path | None = None,
) -> dict[str, Any]:
    """Trains one twin and measures it; one row. Its held-out renders and the twin itself are kept if asked.

    Raises:
        Cancelled: the user stopped the training.
    """
    ready = kitchen.ingredients(method, replace(base, seed=seed))
    wall, cpu = time.perf_counter(), time.process_time()
    views = [view for view in undistorted_views(ready.photos, data.cameras) if view.name not in measure.held]
    if not views:
        raise DgsError(f"'{data.name}' has too few photos to hold some out", "Give a set of 9 photos or more")
    trained = train(views, [], data.cameras.points, ready.medium, ready.settings, Quiet(progress))
    if trained.steps < ready.settings.steps and progress.cancelled():
        raise Cancelled(f"Stopped while '{method}' was trained", "Go on with --resume")
    if twin is not None:
        make_folder(twin.parent)
        write_ply(twin, trained.gaussians.cloud())
    seconds = {"deconvolution": ready.seconds, "wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    return {
        "method": method,
        "seed": seed,
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
        "gaussians": len(trained.gaussians),
        "steps": trained.steps,
        "told": ready.told,
        "background": list(trained.background),
        **measure.twin(trained, renders),
    }


def _prepare(
    todo: Sequence[tuple[str, int]],
    kitchen: Kitchen,
    settings: CompareSettings,
    base: TrainingSettings,
    folder: str,
    key: str,
) -> None:
    """What takes long to deconvolve comes first, so that the time left of the trainings can be told."""
    for method, seed in todo:
        file = settings.out / folder / f"{method.replace(' ', '_')}-{seed}.json"
        if method.startswith("rl ") and seed == 0 and not (settings.resume and _kept(file, key)):
            kitchen.ingredients(method, base)


def run_key(settings: CompareSettings, data: Dataset, base: TrainingSettings) -> str:
    """Rows of other settings, another medium, other cameras or other photos are other rows."""
    content = hashlib.sha256()
    for name in data.cameras.names:
        content.update(f"{name} {data.cameras.poses[name].centre.round(6).tolist()}".encode())
    for photo in data.photos:
        content.update(photo.name.encode() + photo.pixels[::7, ::7].tobytes())
    training = {name: value for name, value in asdict(base).items() if name not in ("threads", "seed")}
    facts = [settings.deciding(), training, data.psf, data.medium.blur_space, data.border, content.hexdigest()]
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:12]


def _kept(file: Path, key: str) -> dict[str, Any] | None:
    try:
        row = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return row if isinstance(row, dict) and row.get("key") == key else None


def _facts(
    settings: CompareSettings, data: Dataset, measure: Measure, base: TrainingSettings, threads: int, device: str
) -> dict[str, Any]:
    pictures = [data.truth.pixels(name) for name in measure.held]
    unit = [picture / float(2 ** (8 * picture.dtype.itemsize) - 1) for picture in pictures]
    return {
        "set": data.name,
        "photos": data.given,
        "registered": len(data.photos),
        "heldout": measure.held,
        "size": list(data.photos[0].size),
        "psf": data.psf,
        "blur_space": data.medium.blur_space,
        "cameras": settings.cameras,
        "quick": settings.quick,
        "grid_step": base.grid_step,
        "steps": base.steps,
        "max_gaussians": base.max_gaussians,
        "variation_weight": base.variation_weight,
        "seeds": settings.seeds,
        "metres": data.metres,
        "poses": measure.poses(),
        "machine": machine(threads, device),
        "truth_low_passed_psnr": {
            f"{cut:g}": mean_of([low_passed_truth_psnr(one, cut) for one in unit]) for cut in CUTOFFS
        },
    }
