"""`estimate`: what a run would take and reach, predicted before it begins."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ..core.imports import large_imports
from ..core.photos.data_set import with_data_set
from ..core.run_settings import ReconstructSettings
from .arguments import add_machine, add_medium, add_memory, add_progress, show_defaults, whole
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Tries a few iterations on some of the photos and predicts seconds, memory and accuracy of every "
        "preset; past runs on this machine calibrate it."
    )
    show_defaults(parser)
    parser.add_argument("photos", type=Path, metavar="PHOTOS", help="folder of photos, or a list of them (.txt)")
    add_medium(parser)
    add = parser.add_argument
    add("--cameras", type=Path, metavar="MODEL", help="given cameras, which need not be found")
    add("--holdout-every", type=whole(0), default=8, metavar="N", help="as of the run")
    add("--max-size", type=whole(16), metavar="PIXELS", help="as of the run")
    add("--max-gaussians", type=whole(100), metavar="N", help="as of the run; the preset's if not given")
    add("--sh-degree", type=whole(0, 3), metavar="D", help="as of the run; the preset's if not given")
    add("--effects", default="usual", metavar="EFFECTS", help="as of the run: auto counts the time of its trials")
    add("--json", action="store_true", help="one JSON object instead of a table")
    add_machine(parser)
    add_memory(parser)
    add_progress(parser)


def estimate_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints the prediction for every preset."""
    with large_imports():
        from ..core.effort.estimate import PhotoSample, RunDescription, estimate, table  # heavy: torch
        from ..core.effort.model import sample  # heavy: torch
        from ..core.machine import Machine  # late: slows --help
        from ..core.pipeline.effects.decision import parse_effects  # heavy: torch
        from ..core.pipeline.sampled import sample_photos  # heavy: torch

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
        memory=options.memory,
        effects=options.effects,
    )
    run = with_data_set(settings, progress).split()
    parse_effects(run.effects)
    machine = Machine.ready(run.threads, run.device)
    few = sample_photos(run.photos, run.medium, sample, progress)
    found = estimate(PhotoSample(few.files, few.photos, few.medium), RunDescription.of(run), machine, progress)
    print(json.dumps(found) if options.json else table(found), flush=True)
    return 0
