"""Gathers what a run found out into report.json (its fields: `core.report.schema`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from ..evaluation.view_scores import BANDS, ViewScores, mean_of
from ..files import plain
from ..imaging.medium import Medium
from ..machine import peak_memory_mb, versions
from ..photos.load import Photo
from ..reconstruction import Reconstruction
from ..views import fingerprint
from .schema import SCHEMA_VERSION
from .verdict import verdict

if TYPE_CHECKING:
    from ..training.run import Trained

#: Of report.json's seconds, in order; a stage that did not run has none.
_STAGES = ("start", "photos", "sfm", "surface", "effects", "compile", "prepare", "train", "save")


@dataclass(frozen=True)
class PhotoFacts:
    """The photos of a run.

    Attributes:
        source: folder or list that they came from.
        held: all held-out names, with a camera or without; every: every how many-th.
    """

    source: Path
    photos: Sequence[Photo]
    held: Sequence[str]
    every: int


@dataclass(frozen=True)
class CameraFacts:
    """Where the photos were taken from.

    Attributes:
        source: 'sfm' or 'given'; file: what the user gave, or None.
        refined: what moving them by the loss found; None where it was not asked for.
    """

    reconstruction: Reconstruction
    source: str
    file: Path | None
    refined: Mapping[str, Any] | None


@dataclass(frozen=True)
class MediumFacts:
    """What blurs the photos.

    Attributes:
        psf: of all photos that have none of their own, as `parse_psf` reads it.
        per_photo: of the others, by name, px of the files, as `parse_psf` reads it.
        medium: on the grid of the photos as used.
        resolvable_period: finest period in px that one photo holds.
    """

    psf: str
    per_photo: Mapping[str, str]
    medium: Medium
    resolvable_period: float


@dataclass(frozen=True)
class TimeFacts:
    """Where the time went.

    Attributes:
        seconds: by stage; total: of them all.
        predicted: what was said before the run; None if nothing was.
    """

    seconds: Mapping[str, float]
    total: float
    predicted: Mapping[str, Any] | None


@dataclass(frozen=True)
class RunFacts:
    """Everything that report.json is made from.

    Attributes:
        asked: settings of the run by their flat names.
        effects: one row for each effect besides the blur; empty where nothing was asked.
        scores: of the held-out views that were rendered; fitted: of a few that were trained on.
        machine: `Machine.facts`; notes: sentences that the run said.
    """

    asked: Mapping[str, Any]
    photos: PhotoFacts
    cameras: CameraFacts
    medium: MediumFacts
    effects: Sequence[Mapping[str, Any]]
    trained: Trained
    scores: Sequence[ViewScores]
    fitted: Sequence[ViewScores]
    time: TimeFacts
    machine: Mapping[str, Any]
    notes: Sequence[str]


def summary(facts: RunFacts) -> dict[str, Any]:
    """The content of report.json: plain values only, NaN as null."""
    trained, time = facts.trained, facts.time
    report = {
        "schema": SCHEMA_VERSION,
        "status": trained.stopped,
        "photos": _photos(facts.photos, facts.cameras.reconstruction),
        "cameras": _cameras(facts.cameras),
        "medium": {
            "psf": facts.medium.psf,
            "blur_space": facts.medium.medium.blur_space,
            "per_photo": facts.medium.per_photo,
            "per_photo_sigma": _range(facts.medium),
        },
        "effects": facts.effects,
        "gaussians": len(trained.gaussians),
        "steps": trained.steps,
        "seconds": {
            **{name: time.seconds.get(name) for name in _STAGES},
            "total": time.total,
            "refine": time.seconds.get("refine"),
        },
        "predicted": time.predicted,
        "peak_memory_mb": peak_memory_mb(),
        "heldout": _heldout(facts),
        "verdict": asdict(verdict(facts.scores, facts.fitted, facts.cameras.reconstruction, trained.history)),
        "resolvable_period_px": facts.medium.resolvable_period,
        "settings": {"run": facts.asked, "training": trained.settings},
        "versions": versions(),
        "machine": facts.machine,
        "counters": {**_before_training(facts.photos.photos), **trained.counters},
        "notes": facts.notes,
        "history": trained.history,
    }
    plain_report: dict[str, Any] = plain(report)
    return plain_report


def _photos(facts: PhotoFacts, cameras: Reconstruction) -> dict[str, Any]:
    names, first = [photo.name for photo in facts.photos], facts.photos[0]
    # Where the photos lie, also those that a list named; the list if they lie in several folders.
    folders = {photo.path.parent for photo in facts.photos}
    return {
        "folder": str(folders.pop() if len(folders) == 1 else facts.source),
        "given": len(names),
        "registered": len(cameras.poses),
        "unregistered": [name for name in names if name not in cameras.poses],
        "size": list(first.size),
        "scale": round(first.scale[0], 6),
        "background": None if first.background is None else first.background.name,
        "transparent": sum(photo.alpha is not None for photo in facts.photos),
    }


def _cameras(facts: CameraFacts) -> dict[str, Any]:
    cameras = facts.reconstruction
    figures = cameras.figures
    return {
        "source": facts.source,
        "file": None if facts.file is None else str(facts.file),
        "focal_px": round(median(lens.fx for lens in cameras.lenses.values()), 3),
        "reprojection_error_px": figures.reprojection_px,
        "points": len(cameras.points.positions),
        "points_scattered": figures.scattered,
        "world_offset": None if figures.offset is None else list(figures.offset),
        "attempts": [asdict(attempt) for attempt in figures.attempts],
        "refined": facts.refined,
    }


def _range(facts: MediumFacts) -> list[float] | None:
    """Least and largest standard deviation (px of the photos as used; mean of both axes) of photos' own blurs."""
    used = [facts.medium.psf_for(name) for name in facts.per_photo]
    sigmas = [0.0 if psf is None else float(np.trace(psf.covariance) / 2) ** 0.5 for psf in used]
    return [round(min(sigmas), 3), round(max(sigmas), 3)] if sigmas else None


def _before_training(photos: Sequence[Photo]) -> dict[str, int]:
    """What was masked or cut in the photos, and which of them are no photos of their own."""
    return {
        "photo px not finite, masked": sum(photo.not_finite for photo in photos),
        "photo px outside [0, 1], cut": sum(photo.clipped for photo in photos),
        "photos that are copies of others": len(photos) - len({fingerprint(photo.pixels) for photo in photos}),
    }


def _heldout(facts: RunFacts) -> dict[str, Any]:
    scores = facts.scores

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
    poses = facts.cameras.reconstruction.poses
    moved = [score.moved for score in scores if score.moved is not None]
    return {
        "names": [score.name for score in scores],
        "unregistered": [name for name in facts.photos.held if name not in poses],
        "every": facts.photos.every,
        "in_sfm": facts.cameras.source == "sfm",
        "moved_px": None if not moved else round(float(np.median(moved)), 3),
        "degraded": {key: mean("degraded", key) for key in ("psnr", "ssim", "psnr_matched", "psnr_halves")},
        "sharp": {key: mean("sharp", key) for key in ("psnr", "ssim", "psnr_inside")},
        "truth_low_passed_psnr": mean_of([score.low_passed for score in compared]),
        "bands": bands if compared else [],
        "edge_sharpness": mean_of([score.edge_sharpness for score in compared]),
        "views": [{"name": s.name, "degraded": s.degraded, "sharp": s.sharp} for s in scores],
    }
