"""What a run would take and reach, predicted before it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..kernel_cache import cache_folder
from ..machine import Machine
from ..photos.load import Photo
from ..progress import Progress
from ..run_settings import PresetName
from ..training.density.budget import ample_gaussians, supported_gaussians
from ..training.job import TrainingJob
from ..training.settings import BLUR_WIDTH, TrainingSettings, harmonics_for, preset_for_sharp
from ..views import heldout_names
from .clock import OthersLoad
from .described import RunDescription
from .model import accuracy, contrast, memory, slowdown, stage_seconds
from .probe import Speed, made_up, probe
from .records import RECORDS, Records, Work, photo_work

__all__ = ["PhotoSample", "RunDescription", "estimate", "kernels_compiled", "table"]

PRESETS: tuple[PresetName, ...] = ("draft", "balanced", "fine", "best")


@dataclass(frozen=True)
class PhotoSample:
    """A few photos, which stand for all.

    Attributes:
        files: all of them; photos: the few; medium: on their grid.
    """

    files: Sequence[Path]
    photos: Sequence[Photo]
    medium: Medium


def estimate(sample: PhotoSample, run: RunDescription, machine: Machine, progress: Progress) -> dict[str, Any]:
    """Tries some iterations on a few photos, and predicts every preset.

    Args:
        run: its preset does not matter.

    Returns:
        'photos', 'size', 'busy' (share of the machine that others use, or None), 'runs' (past runs of this machine that
        count), 'scenes', 'probe_seconds', 'trials' (whether effects are tried), and 'presets': by name seconds, stages,
        memory_mb, psnr (None where not calibrated), steps, gaussians. Ranges hold four of five outcomes.

    Raises:
        OSError: a photo's file is gone.
    """
    records, compiled = Records(machine.facts), kernels_compiled()
    held = len(heldout_names([file.name for file in sample.files], run.holdout_every))
    fitted = max(1, len(sample.files) - held)
    progress.stage("probe", None)
    others = OthersLoad()
    speeds: dict[int, Speed] = {}
    for name in PRESETS:  # degrees of the harmonics differ, and with them what an iteration takes
        degree = _degree(sample, run, name)
        if degree not in speeds:
            speeds[degree] = _probed(sample, run, machine, (fitted, held), degree)
    busy = others.share()
    own, scene = contrast(sample.photos), run.scene_key(sample.files)
    out: dict[str, Any] = {}
    for name in PRESETS:
        preset = _preset(sample, run, name, fitted)
        count = run.max_gaussians or min(preset.max_gaussians, _supported(sample, run, name, fitted))
        hurried = name == "draft"
        few = photo_work(sample.photos, search=run.search, hurried=hurried, compiled=compiled, points=run.points)
        work = _scaled(few, len(sample.files)).training(fitted, held, preset.steps, count)
        train = speeds[_degree(sample, run, name)].training(preset.steps, count)
        stages, seconds = stage_seconds(records.runs, work, train, slowdown(busy), run.trials)
        expected = accuracy(records.runs, name, scene, own)
        out[name] = {
            "seconds": seconds.plain(),
            "stages": {k: round(v, 1) for k, v in stages.items()},
            "memory_mb": memory(records.runs, work, run.memory).plain(0),
            "psnr": None if expected is None else expected.plain(2),
            "steps": preset.steps,
            "gaussians": count,
            "train_probed": round(train, 3),
        }
        records.predict(run.job_key(scene, name), out[name])
    return {
        "photos": len(sample.files),
        "size": list(sample.photos[0].size),
        "busy": None if busy is None else round(busy, 2),
        "runs": sum(past.clean for past in records.runs),
        "scenes": len({past.scene for past in records.runs}),
        "probe_seconds": round(sum(speed.seconds for speed in speeds.values()), 2),
        "machine": machine.facts,
        "memory_limit": run.memory,
        "trials": run.trials,
        "presets": out,
    }


def _preset(sample: PhotoSample, run: RunDescription, name: PresetName, fitted: int) -> TrainingSettings:
    """As a run takes it that finds no blur but the medium's."""
    preset = TrainingSettings.preset(name)
    if _sigma(sample) > BLUR_WIDTH.sharp_until:
        return preset
    ample = ample_gaussians(made_up(sample.photos)[0], _degree(sample, run, name), photos=fitted)
    return preset_for_sharp(preset, ample)


def _sigma(sample: PhotoSample) -> float:
    """Of the blur, px."""
    return sample.medium.mean_sigma([photo.name for photo in sample.photos])


def _degree(sample: PhotoSample, run: RunDescription, name: PresetName) -> int:
    """Of the harmonics of a run with a preset."""
    if run.sh_degree is not None:
        return run.sh_degree
    return harmonics_for(TrainingSettings.preset(name), _sigma(sample))


def _supported(sample: PhotoSample, run: RunDescription, name: PresetName, fitted: int) -> int:
    """Gaussians that so many photos can hold."""
    return supported_gaussians(made_up(sample.photos)[0], _degree(sample, run, name), photos=fitted)


def _probed(sample: PhotoSample, run: RunDescription, machine: Machine, photos: tuple[int, int], degree: int) -> Speed:
    """What iterations cost; `photos`: that are fitted and held out."""
    views, points = made_up(sample.photos)
    settings = TrainingSettings(loss=run.loss, device=machine.device, threads=machine.threads, sh_degree=degree)
    return probe(TrainingJob(views, [], points, sample.medium, settings, Formation()), *photos)


def table(found: dict[str, Any]) -> str:
    """What `estimate` found, and what to think of it, for a terminal."""
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
        lines.append(f"Times are rough: {found['runs']} runs were measured here; each 'reconstruct' makes them better.")
    limit = found["memory_limit"]
    large = [name for name, one in found["presets"].items() if limit and one["memory_mb"]["value"] > limit / 1e6]
    if large:
        lines.append(f"With less than {limit / 1e6:.0f} MB these cannot do: {', '.join(large)}. Use --max-size.")
    if any(one["psnr"] is None for one in found["presets"].values()):
        lines.append(
            "'not calibrated': accuracy is predicted after runs of this preset on 4 other scenes, or on this one."
        )
    if found["trials"]:
        lines.append(
            "With the trials of effects, which take minutes more where short ones do not settle a shake; one that is"
        )
        lines.append("confirmed makes the training longer: a shake or a focus of each photo up to five times.")
    lines.append("'best' takes so long at most: it ends as soon as held-out photos gain no more.")
    if found["busy"] is not None and found["busy"] > RECORDS.disturbed_share:
        lines.append(f"Other programs keep {100 * found['busy']:.0f} % of the machine busy: it may take much longer.")
    return "\n".join(lines)


def kernels_compiled() -> bool:
    """Whether the kernels lie compiled in the cache, for whoever may read it."""
    try:
        return any(cache_folder().rglob("*.nbi"))
    except OSError:
        return False


def _scaled(work: Work, photos: int) -> Work:
    """What a few photos say of all."""
    return replace(work, photos=photos, files_megapixels=work.files_megapixels * photos / max(1, work.photos))
