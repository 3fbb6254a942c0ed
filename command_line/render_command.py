"""`render`: images of a twin from the cameras of a model."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.background import BLACK, parse_colour
from ..core.devices import choose_device
from ..core.errors import Cancelled
from ..core.files import check_writable
from ..core.imports import large_imports
from ..core.outputs import check_outputs, placing_outputs
from .arguments import CAMERAS, SPLATS, add_machine, add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = "Renders a twin from the cameras of a model."
    show_defaults(parser)
    add = parser.add_argument
    add("twin", type=Path, metavar="TWIN", help=SPLATS)
    add("--cameras", type=Path, required=True, metavar="MODEL", help=CAMERAS)
    add("--out", type=Path, required=True, metavar="DIR", help="folder for NAME.png")
    add("--psf", default="none", metavar="PSF", help="also blur, as in 'reconstruct'")
    add("--blur-space", choices=("srgb", "linear"), default="srgb", help="where the blur acts")
    add(
        "--background",
        default="black",
        metavar="COLOUR",
        help="behind the twin: white, black, '#rrggbb', or 'transparent' for PNGs with alpha",
    )
    add_overwrite(parser)
    add_machine(parser)
    add_progress(parser)


def render_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT/NAME.png for every camera of the model, sharp or through the given PSF."""
    with large_imports():
        from ..core.formats.cameras import read_cameras  # heavy: numpy
        from ..core.formats.gaussians import read_gaussians, unusable  # heavy: numpy
        from ..core.imaging.medium import Medium  # heavy: torch
        from ..core.imaging.psf_text import parse_psf  # heavy: torch
        from ..core.machine import use_machine  # late: slows --help

    psf = parse_psf(options.psf)
    behind = None if options.background == "transparent" else parse_colour(options.background)
    cloud = read_gaussians(options.twin)
    fault = unusable(cloud)
    if fault:
        progress.note(f"'{options.twin}': {fault}")
    check_writable(options.out)

    with large_imports():
        from ..core.gaussians import Gaussians  # heavy: torch
        from ..core.photos.undistort import Undistortion  # heavy: torch
        from ..core.photos.write import render_names, write_png  # heavy: torch
        from ..core.pipeline.views import Viewer, to_pixels  # heavy: torch
        from ..core.training.scale import twin_scale  # heavy: torch

    use_machine(options.threads)
    model = read_cameras(options.cameras)
    lenses, poses = model.lenses, model.poses
    medium = Medium(psf, options.blur_space)
    names = sorted(poses)
    scale = twin_scale([Undistortion(lenses[name]).camera(name, poses[name]) for name in names], cloud.means)
    viewer = Viewer(Gaussians.from_cloud(cloud), scale, choose_device(options.device), background=behind or BLACK)
    draw = viewer.transparent if behind is None else viewer.degraded
    files = render_names(names)
    read = [options.twin, options.cameras, *([model.place] if model.place.is_file() else model.place.glob("*"))]
    check_outputs([options.out / file for file in files.values()], read, options.overwrite)
    progress.stage("render", len(files))
    done = 0
    with placing_outputs(options.out, "render", progress.note) as folder:
        for name, file in files.items():
            if progress.cancelled():
                break
            write_png(folder / file, to_pixels(draw(lenses[name], poses[name], medium, name)))
            done += 1
            progress.advance(done)
    if done < len(files):
        raise Cancelled(f"Stopped after {done} of {len(files)} pictures; they are in '{options.out}'")
    progress.finished({"pictures": len(files), "folder": str(options.out)})
    return 0
