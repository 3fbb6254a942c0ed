"""Trains and measures every method with every seed; rows are kept on disk and taken up again."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ...core.devices import choose_device
from ...core.errors import Cancelled, DgsError
from ...core.evaluation.metrics import low_passed_truth_psnr
from ...core.evaluation.view_scores import mean_of
from ...core.files import make_folder, read_json, write_json
from ...core.formats.ply import write_ply
from ...core.machine import machine, use_machine
from ...core.progress import Progress
from ...core.training.grid import grid_step
from ...core.training.settings import TrainingSettings
from . import table
from .dataset import Dataset, load_dataset
from .measure import Measure
from .methods import CHOSEN, LUCY_MEASURED, MAIN, VARIATION, MethodRunner, searched
from .pictures import write_pictures
from .settings import CompareSettings, Elsewhere, StudySettings

#: Cycles/px up to which the low-passed truths hold everything: what one view holds of the ball, and a goal beyond it.
CUTOFFS = (0.11, 0.125)
#: What --quick spends on each twin.
QUICK_STEPS, QUICK_GAUSSIANS = 120, 4000
#: Folder of photos that took long to deconvolve, until the comparison is finished.
DECONVOLVED = "deconvolved"


#: Table rows by plain names, as they are kept on disk.
Row = dict[str, Any]


@dataclass(frozen=True)
class Comparison:
    """What all rows of a table share.

    Attributes:
        settings: what was asked for.
        data: the set; measure: measures its twins.
        base: the training's settings for all methods.
        folder: of the rows inside `settings.out`; only those in 'rows' keep their twins and renders.
        elsewhere: where rows are made; None: here, one after the other.
    """

    settings: CompareSettings
    data: Dataset
    measure: Measure
    base: TrainingSettings
    progress: Progress = field(repr=False)
    folder: str = "rows"
    elsewhere: Elsewhere | None = None

    @property
    def keeps_twins(self) -> bool:
        """Whether the twins of the first seed are kept, for pictures."""
        return self.folder == "rows"

    def file(self, method: str, seed: int) -> Path:
        """Of a row."""
        return self.settings.out / self.folder / f"{method.replace(' ', '_')}-{seed}.json"

    def rows(self, wanted: Sequence[str], seeds: Sequence[int] | None = None) -> list[Row]:
        """One row for each method and seed; those on disk are read if the settings are the same."""
        seeds = range(self.settings.seeds) if seeds is None else seeds
        todo = [(method, seed) for method in wanted for seed in seeds]
        if not todo:
            return []
        key = run_key(self.settings, self.data, self.base)
        if self.elsewhere is not None:
            missing = [self.file(*row).stem for row in todo if self._kept(*row, key) is None]
            self.elsewhere(missing)
            return replace(self, elsewhere=None, settings=replace(self.settings, resume=True)).rows(wanted, seeds)
        kept = self.settings.out / DECONVOLVED / key if self.keeps_twins else None
        runner = MethodRunner(self.data, self.progress, kept, self.base.threads)
        if self.keeps_twins:
            self._prepare(todo, runner, key)
        self.progress.stage("compare", len(todo))
        rows = []
        for number, (method, seed) in enumerate(todo, start=1):
            row = self._kept(method, seed, key)
            if row is None:
                if self.progress.cancelled():
                    raise Cancelled(f"Stopped after {number - 1} of {len(todo)} runs", "Go on with --resume")
                row = {"key": key, **self._run(method, seed, runner)}
                write_json(self.file(method, seed), row)
            rows.append(row)
            self.progress.advance(number, psnr=row["heldout"]["psnr"] or float("nan"))
        return rows

    def _kept(self, method: str, seed: int, key: str) -> Row | None:
        """The row on disk, if it may be taken up and its twin is there where one is kept."""
        row = read_row(self.file(method, seed), key) if self.settings.resume else None
        twin = self._twin(method, seed)
        return row if twin is None or twin.is_file() else None

    def _twin(self, method: str, seed: int) -> Path | None:
        name = f"{method.replace(' ', '_')}.ply"
        return self.settings.out / "twins" / name if seed == 0 and self.keeps_twins else None

    def _run(self, method: str, seed: int, runner: MethodRunner) -> Row:
        """Trains one twin and measures it. Its held-out renders and the twin itself are kept of the first seed."""
        trained, inputs, seconds = runner.trained(method, replace(self.base, seed=seed))
        twin = self._twin(method, seed)
        if twin is not None:
            make_folder(twin.parent)
            write_ply(twin, trained.gaussians.cloud())
        renders = self.settings.out / "renders" / method.replace(" ", "_") if twin is not None else None
        return {
            "method": method,
            "seed": seed,
            "seconds": {name: round(value, 1) for name, value in seconds.items()},
            "gaussians": len(trained.gaussians),
            "steps": trained.steps,
            "estimate": inputs.estimate,
            "background": list(trained.background),
            **self.measure.twin(trained, renders),
        }

    def _prepare(self, todo: Sequence[tuple[str, int]], runner: MethodRunner, key: str) -> None:
        """What takes long to deconvolve comes first, so that the time left of the trainings can be estimated."""
        for method, seed in todo:
            kept = self.settings.resume and read_row(self.file(method, seed), key)
            if method.startswith("rl ") and seed == 0 and not kept:
                runner.inputs(method, self.base)


def compare(settings: CompareSettings, progress: Progress, elsewhere: Elsewhere | None = None) -> dict[str, Any]:
    """Runs all methods, writes table (JSON, Markdown) and pictures to `settings.out`, returns the table.

    Where single rows are asked for, only they are written and returned.

    Args:
        elsewhere: has rows made by others.

    Raises:
        DgsError: the set or a method cannot be used.
        Cancelled: the user asked to stop; finished rows stay, and --resume goes on from them.
    """
    threads = use_machine(settings.threads)
    device = choose_device(settings.device)
    make_folder(settings.out)
    data = load_dataset(settings, threads, progress)
    base = training_settings(settings, data, threads, device)
    if data.reference is None:
        progress.note("The set has no cameras of its own: no pose errors and no line widths")
    measure = Measure(data)
    compared = Comparison(settings, data, measure, base, progress, elsewhere=elsewhere)
    if settings.rows:
        return {"rows": [row for name in settings.rows for row in compared.rows(*_of_file(name))]}
    rows = _rows(compared)
    facts = _facts(settings, data, measure, base, threads, device)
    content = {"facts": facts, "methods": table.summarised(rows, CHOSEN), "rows": rows}
    write_json(settings.out / "compare.json", content)
    content["pictures"] = write_pictures(settings.out, data, measure, content, progress)
    write_json(settings.out / "pictures.json", content["pictures"])
    table.write(settings.out / "compare.md", content)
    shutil.rmtree(settings.out / DECONVOLVED, ignore_errors=True)
    return content


def _rows(compared: Comparison) -> list[Row]:
    """The main methods with all seeds; a search with one; and the best that it finds with all seeds again."""
    settings = compared.settings
    if settings.only:
        return compared.rows(settings.only)
    rows = compared.rows(MAIN)
    estimate = next((row["estimate"] for row in rows if row["method"] == LUCY_MEASURED), "")
    search = [method for method in searched(settings.quick) if not estimate.startswith(f"{_count(method)} iterations")]
    rows += compared.rows(search, seeds=range(1))
    each = table.summarised(rows, CHOSEN)["each"]
    alike = {name: entry for name, entry in each.items() if name.endswith(VARIATION)}
    best = [name for kind in ("wiener", "rl") if (name := table.best(alike, kind)) in search]
    return rows + compared.rows(best, seeds=range(1, settings.seeds))


def _of_file(name: str) -> tuple[list[str], list[int]]:
    """Method and seed of a row, from its file's name.

    Raises:
        DgsError: no row is called so.
    """
    method, _, seed = name.rpartition("-")
    if not method or not seed.isdecimal():
        raise DgsError(f"There is no row '{name}'", "Rows are called METHOD-SEED, such as dgs-0")
    return [method.replace("_", " ")], [int(seed)]


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


def run_key(settings: StudySettings, data: Dataset, base: TrainingSettings) -> str:
    """Rows of other settings, another medium, other cameras or other photos are other rows."""
    content = hashlib.sha256()
    for name in data.cameras.names:
        content.update(f"{name} {data.cameras.poses[name].centre.round(6).tolist()}".encode())
    for photo in data.photos:
        content.update(photo.name.encode() + photo.pixels[::7, ::7].tobytes())
    training = {name: value for name, value in asdict(base).items() if name not in ("threads", "seed")}
    facts = [settings.deciding(), training, data.psf, data.medium.blur_space, data.border, content.hexdigest()]
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:12]


def read_row(file: Path, key: str) -> Row | None:
    """A row on disk; None if there is none, or one that was made with other settings."""
    try:
        row = read_json(file)
    except (OSError, ValueError):
        return None
    if not isinstance(row, dict) or row.get("key") != key:
        return None
    return row


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
