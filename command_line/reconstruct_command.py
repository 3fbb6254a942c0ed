"""`reconstruct`: photos in, sharp twin out."""

from __future__ import annotations

import argparse
from typing import Any

from ..core.errors import Cancelled
from ..core.run_settings import ReconstructSettings
from .progress_choice import Reporting


def reconstruct_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the whole pipeline; 130 if it was stopped (the twin so far is saved and reported)."""
    from ..core.effort.clock import process_began
    from ..core.pipeline.reconstruct import reconstruct

    settings = ReconstructSettings(
        photos=options.photos,
        out=options.out,
        psf=options.psf,
        blur_space=options.blur_space,
        cameras=options.cameras,
        truth=options.truth,
        masks=options.masks,
        holdout_every=options.holdout_every,
        frames=options.frames,
        max_size=options.max_size,
        preset=options.preset,
        loss=options.loss,
        time_limit=options.time_limit,
        max_gaussians=options.max_gaussians,
        sh_degree=options.sh_degree,
        seed=options.seed,
        device=options.device,
        threads=options.threads,
        resume=options.resume,
        refine_cameras=options.refine_cameras,
        reference_cameras=options.reference_cameras,
        snapshots=options.snapshots,
        effects=options.effects,
        until=options.until_quality,
        min_steps=options.min_steps,
    )
    outcome = reconstruct(settings, progress, process_began())
    progress.finished(_result(settings, outcome.report))
    if outcome.cancelled:
        raise Cancelled(
            f"Stopped; the twin so far and its report are in '{settings.out}'", "Add --resume to go on from there"
        )
    return 0


def _result(settings: ReconstructSettings, report: dict[str, Any]) -> dict[str, object]:
    heldout, out = report["heldout"], settings.out
    return {
        "report": str(out / "report.html"),
        "figures": str(out / "report.json"),
        "twin": str(out / "twin.ply"),
        "cameras": str(out / "cameras"),
        "renders": str(out / "renders") if heldout["names"] else None,
        "gaussians": report["gaussians"],
        "registered": f"{report['photos']['registered']} of {report['photos']['given']}",
        "psnr sharp": heldout["sharp"]["psnr"],
        "psnr photos": heldout["degraded"]["psnr"],
        "seconds": report["seconds"]["total"],
    }
