"""Arguments that several commands share, and the kinds of values that they take."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from ..core.devices import devices
from ..core.run_settings import DEFAULT_FRAMES

#: Which files are meant. The formats themselves are in `core.formats`, whose tables load numpy: no list stands here,
#: so that `--help` answers at once. A file of no format is refused with the list.
SPLATS = "file of Gaussians: a twin.ply, or any format that Blender's import of splats reads"
CAMERAS = "cameras, such as the folder of a COLMAP model, a transforms.json or poses_bounds.npy"
#: Of steps, splats, frames and files, where no option says otherwise: what is larger fits no memory and no lifetime.
LARGEST_COUNT = 10**9
#: Bytes: more than any machine has.
LARGEST_MEMORY = 10**15
_BYTES = {"M": 10**6, "G": 10**9, "T": 10**12}
_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}


def duration(text: str) -> float:
    """Seconds from '120', '120s', '2m' or '1.5h'."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|m|min|h|)", text.strip())
    seconds = float(match[1]) * _SECONDS[match[2]] if match else 0.0
    if seconds <= 0:
        raise argparse.ArgumentTypeError(f"'{text}' is no duration; write 120s, 2m or 1h")
    return seconds


def quality(text: str) -> float | Literal["plateau"]:
    """'plateau', or a PSNR in dB from '28', '28.5dB' or '28.5 dB'."""
    asked = text.strip().lower()
    if asked == "plateau":
        return "plateau"
    try:
        value = float(asked.removesuffix("db"))
    except ValueError:
        value = math.nan
    if not 0.0 < value < 100.0:
        raise argparse.ArgumentTypeError(f"'{text}' is neither plateau nor a PSNR in dB such as 28.5")
    return value


def size(text: str) -> int:
    """Bytes from '4G', '1.5G', '800M' or '4GB' (10^9 and 10^6)."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([MGT])B?", text.strip().upper())
    if match is None or not 0 < float(match[1]) * _BYTES[match[2]] <= LARGEST_MEMORY:
        raise argparse.ArgumentTypeError(f"'{text}' is no size; write 4G or 800M")
    return int(float(match[1]) * _BYTES[match[2]])


def whole(low: int, high: int = LARGEST_COUNT) -> Callable[[str], int]:
    """An argument type: a whole number from `low` to `high`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            span = (
                f"from {low} to {high}" if high < LARGEST_COUNT else f"of at least {low}, and at most {LARGEST_COUNT}"
            )
            raise argparse.ArgumentTypeError(f"'{text}' is no whole number {span}")
        return value

    return parse


def above_zero(text: str) -> float:
    """An argument type: a number above zero that leaves room to compute with it."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-30 < value < 1e30:
        raise argparse.ArgumentTypeError(f"'{text}' is no number above zero, or too small or large to compute with")
    return value


def add_machine(parser: argparse.ArgumentParser) -> None:
    """Device and threads."""
    parser.add_argument(
        "--device",
        choices=("auto", *devices()),
        default="auto",
        help="where to compute (auto: the processor, and a training on a graphics card where that is quicker)",
    )
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="CPU threads; all cores if not given")


def add_memory(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """How much memory the run should hold at most."""
    parser.add_argument(
        "--memory",
        type=size,
        metavar="SIZE",
        help="keep photos on disk instead of in memory, and hold at most so much, such as 4G: sets larger than the "
        "memory; the same twin",
    )


def add_progress(parser: argparse.ArgumentParser) -> None:
    """How the command reports its progress, and whether another program steers it."""
    parser.add_argument(
        "--progress",
        choices=("auto", "json", "none"),
        default="auto",
        help="bars on a terminal and lines elsewhere, one JSON object a line, or nothing",
    )
    parser.add_argument(
        "--control",
        action="store_true",
        help="for programs: obey lines on standard input (cancel, pause, continue), and end when it is closed",
    )


def add_medium(parser: argparse.ArgumentParser) -> None:
    """What blurs the photos."""
    medium = parser.add_argument_group("what blurs the photos")
    medium.add_argument(
        "--psf",
        metavar="PSF",
        help="point spread function (if not given none, or with --effects auto what the photos show): none | "
        "gaussian:SIGMA | gaussian:SX,SY,ANGLE (px of the photos as they "
        "are, degrees) | file:PATH (.npy, .tif, .png, .fits) | per-photo:FILE.json (by photo name, '*' for others) | "
        "auto (reconstruct only: estimated from the photos) | auto-each (and each photo's own width around it)",
    )
    medium.add_argument(
        "--blur-space",
        choices=("srgb", "linear"),
        default="srgb",
        help="whether the blur acts on the photos' sRGB values or on linear light",
    )


def add_photos(parser: argparse.ArgumentParser) -> None:
    """The photos, and the folder of the results."""
    parser.add_argument(
        "photos",
        type=Path,
        metavar="PHOTOS",
        help="folder of photos, or of photos with their cameras, a list of photos (.txt, one a line), or a movie",
    )
    parser.add_argument(
        "--frames",
        type=whole(3),
        default=DEFAULT_FRAMES,
        metavar="N",
        help="of a movie, use at most N frames: the sharpest of N equal stretches",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for all results")


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Whether files of others may be replaced."""
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="replace files that this program did not write (they are listed in '.dgs-written' beside them), or that "
        "were changed since; what the command reads is never replaced",
    )


def add_masks(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Masks of the photos."""
    parser.add_argument("--masks", type=Path, metavar="DIR", help="images of the same names; black pixels do not count")


def add_background(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """What is behind the object."""
    parser.add_argument(
        "--background",
        default="auto",
        metavar="COLOUR",
        help="what is behind the object and counts as empty: a colour (white, black, '#rrggbb'), 'none', or 'auto': "
        "white behind transparent photos, and a plain colour that all photos show",
    )


def add_max_size(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """The size that photos are shrunk to."""
    parser.add_argument(
        "--max-size", type=whole(16), metavar="PIXELS", help="shrink photos to this longer side, with cameras and PSF"
    )


def show_defaults(parser: argparse.ArgumentParser) -> None:
    """`--help` shows the default of every argument that has one."""
    parser.formatter_class = argparse.ArgumentDefaultsHelpFormatter
