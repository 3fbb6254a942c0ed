"""`cameras`: only the cameras of photos."""

from __future__ import annotations

import argparse

from ..core.run_settings import ReconstructSettings
from .progress_choice import Reporting


def cameras_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT/cameras; `reconstruct --resume` takes them from there."""
    from ..core.pipeline.only_cameras import only_cameras

    settings = ReconstructSettings(
        photos=options.photos,
        out=options.out,
        psf=options.psf,
        blur_space=options.blur_space,
        masks=options.masks,
        frames=options.frames,
        max_size=options.max_size,
        device=options.device,
        threads=options.threads,
    )
    found = only_cameras(settings, progress)
    figures = found.figures
    progress.finished(
        {
            "cameras": str(options.out / "cameras"),
            "registered": f"{figures.registered} of {figures.given}",
            "points": len(found.points.positions),
            "focal px": round(figures.focal_px, 1),
            "reprojection px": round(figures.reprojection_px, 3),
        }
    )
    return 0
