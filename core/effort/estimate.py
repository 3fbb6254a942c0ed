"""What a run would take and reach, told before it begins."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..compiled import cache_folder
from ..devices import choose_device
from ..errors import Cancelled, PhotoError, PsfError
from ..machine import machine, use_threads
from ..photos.load import Photo, load_photo, photo_files
from ..photos.movie import is_movie
from ..pipeline.blind import Spreads, spreads_of, told_spreads
from ..pipeline.reconstruct import medium_for
from ..progress import Progress
from ..run_settings import ReconstructSettings
from ..training.settings import PresetName, TrainingSettings
from ..views import heldout_names
from .clock import OthersLoad
from .model import accuracy, contrast, memory, sample, slowdown, stage_seconds
from .plan import work_of
from .probe import made_up, probe
from .records import DISTURBED, Records, Work

PRESETS: tuple[PresetName, ...] = ("draft", "balanced", "fine")


def estimate(settings: ReconstructSettings, progress: Progress) -> dict[str, Any]:
    """Reads a few photos, tries some iterations on them, and predicts every preset.

    Args:
        settings: as of the run; `out` is not touched, and its preset does not matter.

    Returns:
        'photos', 'size', 'busy' (share of the machine that others use, or None), 'runs' (past runs of this machine that
        count), 'scenes', 'probe_seconds', and 'presets': by name seconds, stages, memory_mb, psnr (None where not
        calibrated), steps, gaussians. Ranges hold four of five outcomes.

    Raises:
        DgsError: the photos or the medium cannot be used.
    """
    asked = told_spreads(settings.psf)
    if is_movie(settings.photos) and not settings.photos.is_dir():
        raise PhotoError(
            f"'{settings.photos.name}' is a movie: its frames have to be chosen first",
            "Run 'cameras' on it once, then give OUT/frames",
        )
    threads, device = use_threads(settings.threads), choose_device(settings.device)
    records = Records(machine(threads, device))
    files = photo_files(settings.photos)
    progress.stage("photos", len(sample(files)))
    compiled = kernels_compiled()
    photos = []
    for index, file in enumerate(sample(files)):
        if progress.cancelled():
            raise Cancelled("Stopped while reading photos")
        photos.append(load_photo(file, settings.max_size))
        progress.advance(index + 1)
    spreads = _spreads(asked, photos, settings, progress)
    medium = medium_for(photos, spreads.psf, settings, spreads.own)
    held = len(heldout_names([file.name for file in files], settings.holdout_every))
    fitted = max(1, len(files) - held)
    progress.stage("probe", None)
    others = OthersLoad()
    views, points = made_up(photos)
    base = TrainingSettings(loss=settings.loss, device=device, threads=threads)
    if settings.sh_degree is not None:
        base = replace(base, sh_degree=settings.sh_degree)
    speed = probe(views, points, medium, base, fitted, held)
    busy = others.share()
    own, scene = contrast(photos), scene_key(settings, files)
    out: dict[str, Any] = {}
    for name in PRESETS:
        preset = TrainingSettings.preset(name)
        count = settings.max_gaussians or preset.max_gaussians
        work = _scaled(
            work_of(photos, fitted, held, preset.steps, count, settings.cameras is None, name == "draft", compiled),
            len(files),
        )
        train = speed.training(preset.steps, count)
        stages, seconds = stage_seconds(records.runs, work, train, slowdown(busy))
        expected = accuracy(records.runs, name, scene, own)
        out[name] = {
            "seconds": seconds.plain(),
            "stages": {k: round(v, 1) for k, v in stages.items()},
            "memory_mb": memory(records.runs, work).plain(0),
            "psnr": None if expected is None else expected.plain(2),
            "steps": preset.steps,
            "gaussians": count,
            "train_probed": round(train, 3),
        }
        records.predict(job_key(settings, scene, name), out[name])
    return {
        "photos": len(files),
        "size": list(photos[0].size),
        "busy": None if busy is None else round(busy, 2),
        "runs": sum(run.clean for run in records.runs),
        "scenes": len({run.scene for run in records.runs}),
        "probe_seconds": round(speed.seconds, 2),
        "machine": machine(threads, device),
        "presets": out,
    }


def _spreads(told: Spreads | None, photos: list[Photo], settings: ReconstructSettings, progress: Progress) -> Spreads:
    """What was told, or the blur that a few photos show; a run looks at all of them."""
    try:
        return spreads_of(told, photos, settings, some=True)[0]
    except PsfError:
        if told is not None:
            raise
        progress.note("A few photos do not tell the blur: reckoned without any, so a run takes longer")
        return Spreads(None)


def told(found: dict[str, Any]) -> str:
    """A table and what to think of it, for a terminal."""
    lines = [
        f"{found['photos']} photos of {found['size'][0]} x {found['size'][1]} px",
        f"{'preset':<10}{'seconds':>18}{'memory MB':>12}{'held-out PSNR':>24}",
    ]
    for name, one in found["presets"].items():
        s, m, p = one["seconds"], one["memory_mb"], one["psnr"]
        seconds = f"{s['value']:.0f} ({s['low']:.0f} to {s['high']:.0f})"
        reach = "not calibrated" if p is None else f"{p['value']:.1f} dB ({p['low']:.1f} to {p['high']:.1f})"
        lines.append(f"{name:<10}{seconds:>18}{m['value']:>12.0f}{reach:>24}")
    if not all(one["seconds"]["calibrated"] for one in found["presets"].values()):
        lines.append(f"Times are rough: {found['runs']} runs are known here; each 'reconstruct' makes them better.")
    if any(one["psnr"] is None for one in found["presets"].values()):
        lines.append("'not calibrated': accuracy is told after runs of this preset on 4 other scenes, or on this one.")
    if found["busy"] is not None and found["busy"] > DISTURBED:
        lines.append(f"Other programs keep {100 * found['busy']:.0f} % of the machine busy: it may take much longer.")
    return "\n".join(lines)


def scene_key(settings: ReconstructSettings, files: Sequence[Path]) -> str:
    """Of photos, their size and medium, whatever the effort."""
    facts = [[file.name, file.stat().st_size] for file in files]
    told = [facts, settings.psf, settings.blur_space, settings.max_size]
    return hashlib.sha256(json.dumps(told).encode()).hexdigest()[:12]


def job_key(settings: ReconstructSettings, scene: str, preset: str) -> str:
    """Of one job: a prediction belongs to it alone."""
    s = settings
    facts = [scene, preset, s.max_gaussians, s.sh_degree, s.holdout_every, s.cameras is None, s.loss]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:12]


def kernels_compiled() -> bool:
    """Whether the kernels lie compiled in the cache."""
    return any(cache_folder().rglob("*.nbi"))


def _scaled(work: Work, photos: int) -> Work:
    """What a few photos say of all."""
    return replace(work, photos=photos, files_megapixels=work.files_megapixels * photos / max(1, work.photos))
