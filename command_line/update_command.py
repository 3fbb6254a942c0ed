"""`update`: new photos into a finished twin, or its last state back."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

from ..core.errors import DgsError, FormatError
from ..core.imports import large_imports
from ..core.sfm.child import Waiting
from ..core.twin.folder import TwinFolder
from .arguments import add_machine, add_progress, show_defaults, whole
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Registers new photos to a twin, distinguishes changes of the medium from changes of the object, and fits "
        "the twin to them from where it stands; the state before is kept (--rollback)."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("twin", type=Path, metavar="TWIN", help="folder that 'reconstruct --out' wrote")
    add("photos", type=Path, nargs="?", metavar="NEW_PHOTOS", help="folder of photos, or a list of them (.txt)")
    add(
        "--cameras",
        type=Path,
        metavar="MODEL",
        help="the new photos' cameras in the twin's world; found from the photos if not given",
    )
    add(
        "--share",
        type=float,
        default=None,
        metavar="S",
        help="steps, as a share of the twin's own training; default: rounds of 0.06 until new photos are explained as "
        "well as old ones, 4 at most",
    )
    add("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N", help="same seed, same twin (CPU)")
    add("--rollback", action="store_true", help="bring the state before the last update back instead")
    add("--json", action="store_true", help="print JSON")
    add_machine(parser)
    add_progress(parser)


def update_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Updates or rolls back; writes TWIN/update.json and TWIN/changes."""
    from ..core.lock import working_on  # late: slows --help

    if not options.twin.is_dir():
        raise FormatError(f"There is no folder '{options.twin}'", "Give the --out folder of 'reconstruct'")
    if options.rollback:
        with working_on(options.twin, "update --rollback", progress.note):
            state = TwinFolder(options.twin).rollback()
        progress.finished({"twin": str(options.twin / "twin.ply"), "state": state.name})
        return 0
    if options.photos is None:
        raise DgsError("There are no new photos to take in", "Name their folder, or give --rollback")
    if options.share is not None and not 0.0 < options.share <= 2.0:
        raise DgsError(f"--share is {options.share:g}", "Give a share above 0 and up to 2")
    waiting = _helper(options)  # it imports its own libraries while this process imports torch
    try:
        with large_imports():
            from ..core.pipeline.update import UpdateSettings, update  # heavy: torch

        settings = UpdateSettings(
            options.twin, options.photos, options.cameras, options.share, options.threads, options.seed
        )
        with working_on(options.twin, "update", progress.note):
            facts = update(settings, progress, waiting)
    finally:
        if waiting is not None:
            waiting.end()
    if options.json:
        print(json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False), flush=True)
        return 0
    medium, thing = facts["medium"], facts["object"]
    progress.finished(
        {
            "new photos": len(facts["photos"]),
            "medium": "as before" if medium["width"] == 1.0 else f"blur {medium['width']:g} times as wide",
            "object": f"changed in {100 * thing['changed_share']:.1f} % of the new photos' px",
            "psnr new photos": f"{facts['psnr_new'][0]:.2f} -> {facts['psnr_new'][1]:.2f} dB",
            "psnr old photos": f"{facts['psnr_old'][0]:.2f} -> {facts['psnr_old'][1]:.2f} dB",
            "changes": str(options.twin / "changes"),
            "seconds": sum(facts["seconds"].values()),
        }
    )
    return 0


def _helper(options: argparse.Namespace) -> Waiting | None:
    """The process that will look for the new photos' cameras, where there are features to match them with."""

    if options.cameras is not None or not TwinFolder(options.twin).features.is_file():
        return None
    try:
        return Waiting(options.twin, options.threads or os.cpu_count() or 1)
    except OSError:  # what is wrong with the folder is said where it is written to
        return None
