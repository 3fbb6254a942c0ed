"""`measure-psf`: the medium's point spread from a calibration photo."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ..core.errors import OutputError
from ..core.imports import large_imports
from ..core.outputs import check_outputs, placing_outputs
from .arguments import add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Measures what the medium does to a point of light, from a photo of one (pinhole, star, bead) "
        "or of a slanted edge (ISO 12233); writes a kernel for --psf file:KERNEL.tif with a picture beside it."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("photo", type=Path, metavar="PHOTO", help="a point of light, or a slanted edge, through the medium")
    add("--out", type=Path, required=True, metavar="KERNEL.tif", help="the kernel (.tif or .npy), for --psf file:...")
    add("--kind", choices=("auto", "point", "edge"), default="auto", help="what was photographed")
    add(
        "--srgb",
        action="store_true",
        help="measure on the photo's values as they stand, for --blur-space srgb or a file that holds linear light; "
        "otherwise the sRGB curve is undone first, for --blur-space linear",
    )
    add("--json", action="store_true", help="print the figures as JSON")
    add_overwrite(parser)
    add_progress(parser)


def measure_psf_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes the kernel and a picture beside it, and prints width and uncertainty."""
    with large_imports():
        from ..core.calibration.measure import measure_psf, write_kernel  # heavy: torch
        from ..core.calibration.measured import mtf50  # heavy: torch
        from ..core.calibration.pictures import draw_psf  # heavy: torch

    if options.out.is_dir():
        raise OutputError(f"'{options.out}' is a folder", "Give --out the name of a file, such as kernel.tif")
    picture = options.out.with_name(f"{options.out.stem}_picture.png")
    check_outputs([options.out, picture], [options.photo], options.overwrite)
    progress.stage("measure")
    measured = measure_psf(options.photo, options.kind, not options.srgb)
    with placing_outputs(options.out.parent, "measure-psf", progress.note) as folder:
        write_kernel(folder / options.out.name, measured)
        draw_psf(folder / picture.name, measured, options.photo.name)
    for note in measured.notes:
        progress.note(note)
    edge = f"an edge, {measured.slant:.1f} degrees slanted" if measured.slant is not None else ""
    half = mtf50(measured.frequencies, measured.mtf)
    result: dict[str, object] = {
        "kernel": str(options.out),
        "picture": str(picture),
        "photographed": edge or "a point of light",
        "sigma px": f"{measured.sigma:.3f} +- {measured.sigma_uncertainty:.3f}",
        "axes px": f"{measured.sigma_x:.3f} x {measured.sigma_y:.3f} at {measured.angle:.0f} deg"
        if measured.sigma_x != measured.sigma_y
        else None,
        "FWHM px": f"{measured.fwhm:.2f} +- {measured.fwhm_uncertainty:.2f}",
        "MTF50": None if half is None else f"{half:.4f} cycles/px",
        "use it with": f"--psf file:{options.out} --blur-space {measured.space}",
    }
    if options.json:
        files = {"kernel": str(options.out), "picture": str(picture)}
        print(json.dumps({**files, **measured.plain()}, indent=2), flush=True)
        return 0
    progress.finished(result)
    return 0
