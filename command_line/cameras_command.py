"""`cameras`: only the cameras of photos."""

from __future__ import annotations

import argparse

from ..core.imports import large_imports
from ..core.outputs import check_output_folder
from ..core.photos.data_set import photos_in
from ..core.run_settings import RUN_MARKS, RUN_REPLACES, ReconstructSettings
from .arguments import (
    add_machine,
    add_masks,
    add_max_size,
    add_medium,
    add_overwrite,
    add_photos,
    add_progress,
    show_defaults,
)
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = "Finds the cameras and writes DIR/cameras, which 'reconstruct --resume' goes on from."
    show_defaults(parser)
    add_photos(parser)
    add_overwrite(parser)
    add_medium(parser)
    add_masks(parser)
    add_max_size(parser)
    add_machine(parser)
    add_progress(parser)


def cameras_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT/cameras; `reconstruct --resume` takes them from there."""
    with large_imports():
        from ..core.pipeline.only_cameras import only_cameras  # heavy: torch

    check_output_folder(options.out, RUN_MARKS, options.overwrite, RUN_REPLACES)
    settings = ReconstructSettings(
        photos=photos_in(options.photos),
        out=options.out,
        psf=options.psf or "none",
        blur_space=options.blur_space,
        masks=options.masks,
        frames=options.frames,
        max_size=options.max_size,
        device=options.device,
        threads=options.threads,
    )
    found = only_cameras(settings.split(), progress)
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
