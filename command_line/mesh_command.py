"""`mesh`: a twin's surface as a mesh."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.imports import large_imports
from .arguments import LARGEST_COUNT, above_zero, add_overwrite, add_progress, show_defaults, whole
from .progress_choice import Reporting

#: Texels of a texture each way, at least and at most: no card takes a larger one.
SIDES = (16, 16384)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Fuses what a twin's cameras see of it to a surface with colours: GLB, OBJ or PLY. "
        "Holes are where no two cameras saw the same surface. Corners have the colours, or a texture has them "
        "(sRGB; within a GLB, beside an OBJ), which shows more than the corners of a mesh of few faces."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("twin", type=Path, metavar="TWIN", help="folder that 'reconstruct --out' wrote")
    add("--out", type=Path, required=True, metavar="FILE", help="ends with .glb, .obj or .ply")
    sides = "side of a voxel, in px of the photos on the surface; smaller is finer and takes longer"
    add("--detail", type=above_zero, default=1.0, metavar="PX", help=sides)
    most = "at most; 0: all that there are; 500000 if not given, with a texture 50000"
    add("--faces", type=whole(0, LARGEST_COUNT), metavar="N", help=most)
    sides = "paint a texture of so many texels each way, 2048 without a number; a PLY takes none"
    add("--texture", type=whole(*SIDES), nargs="?", const=2048, default=0, metavar="SIZE", help=sides)
    add("--views", type=whole(1, LARGEST_COUNT), default=60, metavar="N", help="cameras at most, evenly chosen")
    where = (
        "where depths come from. filled: where cameras agree on what they see of the twin, and its own depths where no"
        " such surface is seen; agreed: the first alone, for measuring, with holes; off: its own depths everywhere,"
        " quicker and less exact"
    )
    add("--matching", choices=("filled", "agreed", "off"), default="filled", help=where)
    add("--threads", type=whole(1, 1024), metavar="N", help="CPU threads; all cores if not given")
    add_overwrite(parser)
    add_progress(parser)


def mesh_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT and says how large, how fine and how whole it is."""
    with large_imports():
        from ..core.mesh.written import MeshSettings, write_twin_mesh  # heavy: torch

    settings = MeshSettings(
        options.detail, options.faces, views=options.views, texture=options.texture, matching=options.matching
    )
    said = write_twin_mesh(
        options.twin, options.out, settings, overwrite=options.overwrite, threads=options.threads, progress=progress
    )
    progress.finished(said)
    return 0
