"""`estimate`: what a run would take and reach, told before it begins."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command besides photos, medium and machine."""
    from .parser import whole  # which reads this file first

    add = parser.add_argument
    add("--cameras", type=Path, metavar="MODEL", help="known cameras, which need not be found")
    add("--holdout-every", type=whole(0), default=8, metavar="N", help="as of the run")
    add("--max-size", type=whole(16), metavar="PIXELS", help="as of the run")
    add("--max-gaussians", type=whole(100), metavar="N", help="as of the run; the preset's if not given")
    add("--sh-degree", type=whole(0, 3), metavar="D", help="as of the run; the preset's if not given")
    add("--json", action="store_true", help="one JSON object instead of a table")


def estimate_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints the prediction for every preset."""
    from ..core.effort.estimate import estimate, told
    from ..core.run_settings import ReconstructSettings

    settings = ReconstructSettings(
        photos=options.photos,
        out=Path("."),
        psf=options.psf,
        blur_space=options.blur_space,
        cameras=options.cameras,
        holdout_every=options.holdout_every,
        max_size=options.max_size,
        max_gaussians=options.max_gaussians,
        sh_degree=options.sh_degree,
        device=options.device,
        threads=options.threads,
    )
    found = estimate(settings, progress)
    print(json.dumps(found) if options.json else told(found), flush=True)
    return 0
