"""`measure-glass`: distance and angle of frosted glass, from a point or an edge photographed at two distances."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from ..core.errors import PhotoError
from ..core.imports import large_imports
from .arguments import add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Measures where a sheet of frosted glass stands before the camera and how far it scatters, from photos of a "
        "point of light or a slanted edge at two distances or more; for --glass of 'reconstruct'."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("photos", type=Path, nargs="+", metavar="PHOTO", help="of a point of light or an edge, through the glass")
    add(
        "--distances",
        type=float,
        nargs="+",
        required=True,
        metavar="D",
        help="from the camera to what each photo shows, along the camera's axis, in the unit that the cameras are in",
    )
    add("--focal", type=float, required=True, metavar="PX", help="focal length in px of these photos")
    add("--json", action="store_true", help="print the figures as JSON")
    add_progress(parser)


def measure_glass_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints distance and angle with their standard errors."""
    for photo in options.photos:
        if not photo.is_file():  # (a pipe would be waited for)
            raise PhotoError(f"'{photo}' is no photo", "Give photos of a point of light or an edge")
    with large_imports():
        from ..core.calibration.glass import glass_from_photos  # heavy: torch

    progress.stage("measure")
    measured, widths = glass_from_photos(options.photos, options.distances, options.focal)
    if options.json:
        values = {
            "distance": measured.distance,
            "distance_error": measured.distance_error,
            "angle": math.degrees(measured.angle),
            "angle_error": math.degrees(measured.angle_error),
            "sigma_px": [width.sigma for width in widths],
        }
        print(json.dumps(values, indent=2), flush=True)
        return 0
    progress.finished(
        {
            "sigma px": ", ".join(f"{w.sigma:.3f} +- {w.error:.3f} at {w.depth:g}" for w in widths),
            "distance": f"{measured.distance:.4g} +- {measured.distance_error:.2g}",
            "angle deg": f"{math.degrees(measured.angle):.4g} +- {math.degrees(measured.angle_error):.2g}",
            "use it with": f"--glass {measured.setting}",
        }
    )
    return 0
