"""`blend`: a Blender scene with a twin and its cameras."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.errors import OutputError
from ..core.outputs import check_outputs
from .arguments import CAMERAS, SPLATS, add_overwrite
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = "Writes a Blender scene with a twin and its cameras."
    add = parser.add_argument
    add("twin", type=Path, metavar="TWIN", help=SPLATS)
    add("--cameras", type=Path, metavar="MODEL", help=f"{CAMERAS}; one is placed if not given")
    add("--photos", type=Path, metavar="DIR", help="photos to show behind the cameras")
    add("--out", type=Path, required=True, metavar="FILE.blend", help="the scene to write")
    add_overwrite(parser)


def blend_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT with the twin and the cameras; needs bpy."""
    from ..dgs_addon.scene.save_blend import save_blend  # heavy: bpy

    if options.out.suffix.lower() != ".blend":
        raise OutputError(f"'{options.out.name}' is no name of a Blender scene", "Give a name that ends in .blend")
    check_outputs([options.out], [options.twin], options.overwrite)
    save_blend(options.twin, options.cameras, options.out, options.photos)
    progress.finished({"blend": str(options.out)})
    return 0
