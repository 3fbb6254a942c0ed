"""Gathers what a run found out into report.json (its fields: `core.report.schema`)."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import plain
from ..imaging.medium import Medium
from ..machine import peak_memory_mb, versions
from ..photos.load import Photo
from ..reconstruction import Reconstruction
from ..report.schema import SCHEMA_VERSION
from ..run_settings import ReconstructSettings
from ..views import fingerprint
from .blind import Spreads
from .heldout import BANDS, Scores, mean_of

if TYPE_CHECKING:
    from ..training.run import Trained
    from .effects.choose import Chosen

#: Standard deviation of 8-bit rounding over the amplitude of typical detail (contrast one half).
NOISE_TO_CONTRAST = 1.0 / (255.0 * math.sqrt(12.0)) / 0.5

#: Of report.json's seconds, in order.
_STAGES = ("start", "photos", "sfm", "effects", "compile", "prepare", "train", "save")


@dataclass(frozen=True)
class Facts:
    """Everything that was decided and found before the scores.

    Attributes:
        source: 'sfm' or 'given'.
        effects: what was decided about each effect besides the blur; None where nothing was asked.
        medium: on the grid of the photos as used; spreads: as asked for, in px of the files.
        held: all held-out names, registered or not.
    """

    settings: ReconstructSettings
    photos: list[Photo]
    reconstruction: Reconstruction
    source: str
    medium: Medium
    spreads: Spreads
    held: list[str]
    trained: Trained
    machine: dict[str, Any]
    notes: list[str]
    effects: Chosen | None = None


def resolvable_period(medium: Medium) -> float:
    """Finest period in px that one 8-bit photo still holds in every direction; 2 without blur.

    Where the PSF's transfer of detail of contrast one half falls below the noise of rounding: about
    9 px for a Gaussian of sigma 5 px.
    """
    if medium.psf is None or medium.psf.is_identity:
        return 2.0
    return round(medium.psf.resolvable_period(NOISE_TO_CONTRAST), 2)


def summary(facts: Facts, scores: list[Scores], seconds: dict[str, float], total: float) -> dict[str, Any]:
    """The content of report.json: plain values only, NaN as null."""
    settings, trained, cameras = facts.settings, facts.trained, facts.reconstruction
    names = [photo.name for photo in facts.photos]
    first = facts.photos[0]
    report = {
        "schema": SCHEMA_VERSION,
        "status": trained.stopped,
        "photos": {
            "folder": str(_folder(facts)),
            "given": len(names),
            "registered": len(cameras.poses),
            "unregistered": [name for name in names if name not in cameras.poses],
            "size": list(first.size),
            "scale": round(first.scale[0], 6),
        },
        "cameras": {
            "source": facts.source,
            "file": None if settings.cameras is None else str(settings.cameras),
            "focal_px": round(median(lens.fx for lens in cameras.lenses.values()), 3),
            "reprojection_error_px": cameras.figures.reprojection_px,
            "points": len(cameras.points.positions),
            "points_scattered": cameras.figures.scattered,
            "world_offset": None if cameras.figures.offset is None else list(cameras.figures.offset),
            "attempts": [asdict(attempt) for attempt in cameras.figures.attempts],
        },
        "medium": {
            "psf": settings.psf,
            "blur_space": facts.medium.blur_space,
            "per_photo": _own_spreads(facts),
            "per_photo_sigma": _range(facts),
        },
        "effects": [] if facts.effects is None else facts.effects.plain(),
        "gaussians": len(trained.gaussians),
        "steps": trained.steps,
        "seconds": {**{name: seconds.get(name) for name in _STAGES}, "total": total},
        "predicted": None,
        "peak_memory_mb": peak_memory_mb(),
        "heldout": _heldout(facts, scores),
        "resolvable_period_px": resolvable_period(facts.medium),
        "settings": {"run": settings.plain(), "training": trained.settings},
        "versions": versions(),
        "machine": facts.machine,
        "counters": {**_before_training(facts.photos), **trained.counters},
        "notes": list(facts.notes),
        "history": list(trained.history),
    }
    plain_report: dict[str, Any] = plain(report)
    return plain_report


def _own_spreads(facts: Facts) -> dict[str, str]:
    """Point spreads of photos that have one of their own, px of the files, as `parse_psf` reads them."""
    own = {name: "none" if psf is None else psf.source for name, psf in facts.spreads.own.items()}
    for effect in [] if facts.effects is None else facts.effects.formation.kernels:
        for photo in facts.photos:
            added = effect.kernel_text(photo.name, 1.0 / photo.scale[0])
            base = own.get(photo.name, facts.spreads.source)
            if added:
                own[photo.name] = added if base == "none" else f"{base}+{added}"
    return own


def _range(facts: Facts) -> list[float] | None:
    """Least and largest standard deviation (px of the photos as used; mean of both axes) of photos' own blurs."""
    used = [facts.medium.psf_for(name) for name in _own_spreads(facts)]
    sigmas = [0.0 if psf is None else float(np.trace(psf.covariance) / 2) ** 0.5 for psf in used]
    return [round(min(sigmas), 3), round(max(sigmas), 3)] if sigmas else None


def _folder(facts: Facts) -> Path:
    """Where the photos lie, also those that a list named; the list if they lie in several folders."""
    folders = {photo.path.parent for photo in facts.photos}
    return folders.pop() if len(folders) == 1 else facts.settings.photos


def _before_training(photos: list[Photo]) -> dict[str, int]:
    """What was masked or cut in the photos, and which of them are no photos of their own."""
    return {
        "photo px not finite, masked": sum(photo.not_finite for photo in photos),
        "photo px outside [0, 1], cut": sum(photo.clipped for photo in photos),
        "photos that are copies of others": len(photos) - len({fingerprint(photo.pixels) for photo in photos}),
    }


def _heldout(facts: Facts, scores: list[Scores]) -> dict[str, Any]:
    def mean(kind: str, name: str) -> float | None:
        return mean_of([(getattr(score, kind) or {}).get(name) for score in scores])

    compared = [score for score in scores if score.sharp is not None]
    bands = [
        {
            "coarsest": coarsest,
            "finest": finest,
            **{key: mean_of([s.bands[i][key] for s in compared]) for key in ("gain", "correlation", "energy")},
        }
        for i, (coarsest, finest) in enumerate(BANDS)
    ]
    return {
        "names": [score.name for score in scores],
        "unregistered": [name for name in facts.held if name not in facts.reconstruction.poses],
        "every": facts.settings.holdout_every,
        "in_sfm": facts.source == "sfm",
        "degraded": {key: mean("degraded", key) for key in ("psnr", "ssim", "psnr_matched")},
        "sharp": {key: mean("sharp", key) for key in ("psnr", "ssim", "psnr_inside")},
        "truth_low_passed_psnr": mean_of([score.low_passed for score in compared]),
        "bands": bands if compared else [],
        "edge_sharpness": mean_of([score.edge_sharpness for score in compared]),
        "views": [{"name": s.name, "degraded": s.degraded, "sharp": s.sharp} for s in scores],
    }
