"""`tradeoff`: what each knob costs in time and brings in accuracy, on a set whose truth is known."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.errors import DgsError
from ..core.files import check_writable
from ..core.outputs import check_output_folder, claim_output_folder
from ..studies.tradeoff.settings import TradeoffSettings
from .arguments import add_machine, add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Trains twins with one knob turned at a time, several seeds each, scores them against the sharp "
        "photos, and draws accuracy over time with the front that nothing beats."
    )
    show_defaults(parser)
    add = parser.add_argument
    add(
        "dataset",
        type=Path,
        metavar="DATASET",
        help="folder with photos/ (or blur5/) and sharp/, such as 'synthesize' writes",
    )
    add("--out", type=Path, required=True, metavar="DIR", help="folder for rows, table, chart and page")
    add("--photos", metavar="NAME", help="name of the folder of blurred photos inside DATASET")
    add("--psf", metavar="PSF", help="what blurred the photos; what DATASET/psf.json says if not given")
    add("--blur-space", choices=("srgb", "linear"), help="where the blur acts; what psf.json says if not given")
    add(
        "--cameras",
        default="found",
        metavar="WHICH",
        help="'found' from the photos (their time counts), 'known' (the set's own), or a camera model",
    )
    add("--seeds", type=int, metavar="N", help="trainings of each point; 3, or 1 with --quick, if not given")
    add(
        "--only",
        action="append",
        default=[],
        metavar="KNOB",
        help="preset, iterations, gaussians, resolution, harmonics, blur, 'float width', loss, cameras or effects; "
        "may be repeated; all if not given",
    )
    add("--target", type=float, metavar="DB", help="PSNR whose time is reported; half a dB below the best if not given")
    add("--quick", action="store_true", help="few points and short trainings: proves the machinery only")
    add("--resume", action="store_true", help="keep the rows in DIR that belong to the same settings")
    add_overwrite(parser)
    add_machine(parser)
    add_progress(parser)


def tradeoff_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Measures, and names the page and the front."""
    from ..studies.tradeoff.chart import front_names  # heavy: torch
    from ..studies.tradeoff.runs import measure_tradeoff  # heavy: torch

    seeds = options.seeds if options.seeds is not None else (1 if options.quick else 3)
    if seeds < 1:
        raise DgsError(f"--seeds must be at least 1, not {seeds}", "Give another number")
    settings = TradeoffSettings(
        dataset=options.dataset,
        out=options.out,
        photos=options.photos,
        psf=options.psf,
        blur_space=options.blur_space,
        cameras=options.cameras,
        seeds=seeds,
        only=tuple(options.only),
        target=options.target,
        quick=options.quick,
        resume=options.resume,
        threads=options.threads,
        device=options.device,
    )
    check_output_folder(settings.out, ("tradeoff.json",), options.overwrite)
    claim_output_folder(settings.out)
    check_writable(settings.out)
    content = measure_tradeoff(settings, progress)
    out = settings.out
    progress.finished(
        {
            "page": str(out / "tradeoff.html"),
            "table": str(out / "tradeoff.csv"),
            "chart": str(out / "tradeoff.png"),
            "front": ", ".join(front_names(content["points"])),
        }
    )
    return 0
