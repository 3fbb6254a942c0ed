"""`board`: a marker board as a picture or a PDF of exact size."""

from __future__ import annotations

import argparse
from pathlib import Path

from .arguments import above_zero, add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Writes printed markers of exact size, from which 'measure --board' takes a twin's scale: loose ones "
        "(aruco:4x4_50,40mm; with ,0-11 these twelve) or a chessboard (charuco:4x4_50,7x5,30mm,22mm: columns x rows, "
        "side of a square, side of a marker). Print at 100 %, measure the print, and give 'measure' what you measured."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("board", metavar="BOARD", help="what is printed; lengths in mm, cm, m or in")
    add("--out", type=Path, required=True, metavar="FILE", help="ends with .pdf (exact) or .png")
    add(
        "--dpi", type=above_zero, default=300.0, metavar="DOTS", help="of a .png: dots per inch that it is printed with"
    )
    add_overwrite(parser)
    add_progress(parser)


def board_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes the sheet and says how large it is."""
    from ..core.measure import boards, printed  # heavy: numpy, matplotlib

    sheet = printed.write_sheet(boards.parsed_board(options.board), options.out, options.dpi, options.overwrite)
    progress.finished({"board": f"{sheet.width:.1f} x {sheet.height:.1f} mm", "written": str(options.out)})
    return 0
