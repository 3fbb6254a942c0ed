"""`compare`: several ways to a twin from the same blurred photos, scored against the sharp ones."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.errors import DgsError
from ..core.files import check_writable
from ..core.outputs import check_output_folder, claim_output_folder
from ..studies.comparison.settings import CompareSettings
from .arguments import add_machine, add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Trains twins from the same blurred photos in several ways (plain, Wiener or Richardson-Lucy "
        "first, the paper's loss, DGS, and from the sharp photos) and scores them against the sharp photos."
    )
    show_defaults(parser)
    add = parser.add_argument
    add(
        "dataset",
        type=Path,
        metavar="DATASET",
        help="folder with photos/ (or blur5/) and sharp/, such as 'synthesize' writes",
    )
    add("--out", type=Path, required=True, metavar="DIR", help="folder for rows, table and pictures")
    add("--photos", metavar="NAME", help="name of the folder of blurred photos inside DATASET")
    add("--psf", metavar="PSF", help="what blurred the photos; what DATASET/psf.json says if not given")
    add("--blur-space", choices=("srgb", "linear"), help="where the blur acts; what psf.json says if not given")
    add(
        "--cameras",
        default="found",
        metavar="WHICH",
        help="'found' from the blurred photos, 'known' (the set's own), or a camera model",
    )
    add("--seeds", type=int, metavar="N", help="trainings of each method; 3, or 1 with --quick, if not given")
    add("--steps", type=int, metavar="N", help="of each training; the product's own if not given")
    add("--max-gaussians", type=int, metavar="N", help="of each twin; the product's own if not given")
    add(
        "--only",
        action="append",
        default=[],
        metavar="METHOD",
        help="plain, paper, dgs, oracle, 'wiener N vW' or 'rl N vW'; may be repeated; all if not given",
    )
    add("--quick", action="store_true", help="few methods and short trainings: proves the machinery only")
    add("--mismatch", action="store_true", help="instead: what happens when the medium is not the one that was given")
    add("--resume", action="store_true", help="keep the rows in DIR that belong to the same settings")
    add_overwrite(parser)
    add_machine(parser)
    add_progress(parser)


def compare_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the comparison, or the mismatch study, and names the table."""

    seeds = options.seeds if options.seeds is not None else (1 if options.quick else 3)
    for name, value in (("seeds", seeds), ("steps", options.steps), ("max-gaussians", options.max_gaussians)):
        if value is not None and value < 1:
            raise DgsError(f"--{name} must be at least 1, not {value}", "Give another number")
    settings = CompareSettings(
        dataset=options.dataset,
        out=options.out,
        photos=options.photos,
        psf=options.psf,
        blur_space=options.blur_space,
        cameras=options.cameras,
        seeds=seeds,
        steps=options.steps,
        max_gaussians=options.max_gaussians,
        only=tuple(options.only),
        quick=options.quick,
        mismatch=options.mismatch,
        resume=options.resume,
        threads=options.threads,
        device=options.device,
    )
    check_output_folder(settings.out, ("compare.json", "mismatch.json"), options.overwrite)
    claim_output_folder(settings.out)
    check_writable(settings.out)
    if settings.mismatch:
        from ..studies.comparison.mismatch import study  # heavy: torch

        study(settings, progress)
        progress.finished({"table": str(settings.out / "mismatch.md")})
        return 0
    from ..studies.comparison.runs import compare  # heavy: torch

    content = compare(settings, progress)
    middle = {method: entry["median"]["psnr"] for method, entry in content["methods"]["each"].items()}
    progress.finished({"table": str(settings.out / "compare.md"), **{f"{m} PSNR": middle[m] for m in middle}})
    return 0
