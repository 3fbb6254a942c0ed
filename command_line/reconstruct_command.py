"""`reconstruct`: photos in, sharp twin out."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from ..core.effects.choices import effects_help
from ..core.errors import Cancelled
from ..core.imports import large_imports
from ..core.outputs import check_output_folder
from ..core.photos.data_set import with_data_set
from ..core.run_settings import RUN_MARKS, RUN_REPLACES, ReconstructSettings
from .arguments import (
    CAMERAS,
    add_background,
    add_machine,
    add_masks,
    add_max_size,
    add_medium,
    add_memory,
    add_overwrite,
    add_photos,
    add_progress,
    duration,
    quality,
    show_defaults,
    whole,
)
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Finds the cameras, fits sharp Gaussians that explain the blurred photos, and writes "
        "twin.ply, cameras/, renders/, report.html and report.json. Processes that torchrun starts train one twin."
    )
    show_defaults(parser)
    add_photos(parser)
    add_overwrite(parser)
    add_medium(parser)
    parser.add_argument(
        "--glass",
        metavar="GLASS",
        help="frosted glass before the camera: auto (its distance is learned), tilted (how it leans, too), standing "
        "(the same of a sheet that stands still while the camera moves) or [standing,]DISTANCE[,ANGLE[,RIGHT,DOWN]] "
        "(the cameras' unit, degrees; what its normal leans by; of a standing sheet before the camera in the middle of "
        "all); without an angle --psf gaussian:SIGMA says how wide it blurs at the scene's middle depth",
    )
    parser.add_argument(
        "--rolling-shutter",
        metavar="READOUT",
        help="rows are exposed one after the other: the time from the first to the last one, in exposures (below 0: "
        "from below), or auto, as if left out, to find it; with --effects motion or auto",
    )
    parser.add_argument("--effects", default="usual", metavar="EFFECTS", help=effects_help())
    _add_given(parser.add_argument_group("what is given"))
    _add_effort(parser.add_argument_group("effort"))
    add_machine(parser)
    add_memory(parser)
    add_progress(parser)


def _add_given(data: argparse._ArgumentGroup) -> None:
    data.add_argument(
        "--cameras", type=Path, metavar="MODEL", help=f"given cameras: {CAMERAS}; found from the photos if not given"
    )
    data.add_argument("--truth", type=Path, metavar="DIR", help="sharp photos of the same names, only for scoring")
    add_masks(data)
    add_background(data)
    data.add_argument(
        "--holdout-every",
        type=whole(0),
        default=8,
        metavar="N",
        help="keep views 0, N, 2N ... by sorted name out of the training to score them; 0 keeps none out",
    )
    add_max_size(data)
    data.add_argument(
        "--adjust-cameras",
        choices=("auto", "never", "always"),
        default="auto",
        help="where photos were shaken, move the cameras with the twin: auto those found in photos, here or by another "
        "program, and others only if the photos contradict them; never keeps them, to measure by exact ones; always "
        "moves all",
    )
    data.add_argument(
        "--refine-cameras",
        action="store_true",
        help="before the training, move cameras and focal length by the loss through the blur; kept "
        "only if held-out photos are explained better (takes about as long as a draft)",
    )
    data.add_argument(
        "--reference-cameras",
        type=Path,
        metavar="MODEL",
        help="true cameras, only to report errors with --refine-cameras",
    )


def _add_effort(effort: argparse._ArgumentGroup) -> None:
    effort.add_argument(
        "--preset",
        choices=("draft", "balanced", "fine", "best"),
        default="balanced",
        help="how much time to spend; best ends when held-out photos gain no more",
    )
    effort.add_argument(
        "--time-limit",
        type=duration,
        metavar="TIME",
        help="from the command to the report, such as 120s or 2m: steps, Gaussians and grid are "
        "planned for it instead of the preset's, and everything is saved by then",
    )
    effort.add_argument(
        "--until-quality",
        type=quality,
        metavar="QUALITY",
        help="end before, on a plateau ('plateau') or at a PSNR in dB on the photos held out; "
        "without --time-limit at most four times the preset's steps",
    )
    effort.add_argument(
        "--min-steps",
        type=whole(0),
        default=0,
        metavar="N",
        help="neither time nor quality ends the training before N steps",
    )
    effort.add_argument("--max-gaussians", type=whole(100), metavar="N", help="the preset's if not given")
    effort.add_argument(
        "--sh-degree",
        type=whole(0, 3),
        metavar="D",
        help="spherical harmonics, 0 (no gloss) to 3; the preset's if not given",
    )
    effort.add_argument(
        "--loss", choices=("dgs", "paper"), default="dgs", help="'paper' keeps the paper's own loss, for comparison"
    )
    effort.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N", help="same seed, same twin (CPU)")
    effort.add_argument(
        "--resume", action="store_true", help="go on with the run in DIR that was stopped, cut off or finished"
    )
    effort.add_argument(
        "--keep-cameras",
        action="store_true",
        help="take the cameras in DIR that were found for these very photos, and train anew",
    )
    effort.add_argument(
        "--snapshots",
        action="store_true",
        help="now and then write the twin so far and a picture of it to DIR/.run/snapshot",
    )


def reconstruct_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Runs the whole pipeline, alone or as one of several ranks; 130 if it was stopped (the twin so far is saved)."""
    with large_imports():
        from ..core.effort.clock import process_began  # late: slows --help
        from ..core.effort.timing import RunDescription, RunTiming  # heavy: torch
        from ..core.pipeline.together import reconstruct  # heavy: torch

    if not options.resume:  # (what goes on there is its own)
        read = options.photos.name if options.photos.parent.resolve() == options.out.resolve() else None
        replaced = [name for name in RUN_REPLACES if name != read]  # (what is read stays)
        check_output_folder(options.out, RUN_MARKS, options.overwrite, replaced)
    settings = ReconstructSettings(
        photos=options.photos,
        out=options.out,
        psf=options.psf,
        blur_space=options.blur_space,
        cameras=options.cameras,
        truth=options.truth,
        masks=options.masks,
        background=options.background,
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
        keep_cameras=options.keep_cameras,
        adjust_cameras=options.adjust_cameras,
        refine_cameras=options.refine_cameras,
        reference_cameras=options.reference_cameras,
        snapshots=options.snapshots,
        effects=options.effects,
        glass=options.glass,
        rolling_shutter=options.rolling_shutter,
        until=options.until_quality,
        min_steps=options.min_steps,
        memory=options.memory,
    )
    settings = with_data_set(settings, progress)
    run = settings.split()
    finished = reconstruct(run, progress, process_began(), partial(RunTiming, RunDescription.of(run)))
    if finished is None:  # another rank says what came out
        return 0
    progress.finished(_result(settings, finished.report))
    if finished.cancelled:
        raise Cancelled(
            f"Stopped; the twin so far and its report are in '{settings.out}'", "Add --resume to go on from there"
        )
    return 0


def _result(settings: ReconstructSettings, report: dict[str, Any]) -> dict[str, object]:
    heldout, out = report["heldout"], settings.out
    halves = heldout["degraded"]["psnr_halves"]
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
        **({"psnr halves": halves} if halves is not None else {}),
        "seconds": report["seconds"]["total"],
        "verdict": " ".join([report["verdict"]["sentence"], *(f"{line}." for line in report["verdict"]["help"])]),
    }
