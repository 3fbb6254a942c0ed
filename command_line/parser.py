"""All arguments of the command line, with their units and defaults."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path
from typing import NoReturn

from ..core.run_settings import DEFAULT_FRAMES
from ..core.version import VERSION
from .effort_parser import add_effort_commands
from .quality import quality
from .twin_parser import add_refinement, add_twin_commands

_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line instead of printing the usage first."""

    def error(self, message: str) -> NoReturn:
        """Ends with usage and one line, exit code 2."""
        self.exit(2, f"{message}. See '{self.prog} --help'.\n")


def duration(text: str) -> float:
    """Seconds from '120', '120s', '2m' or '1.5h'."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|m|min|h|)", text.strip())
    seconds = float(match[1]) * _UNITS[match[2]] if match else 0.0
    if seconds <= 0:
        raise argparse.ArgumentTypeError(f"'{text}' is no duration; write 120s, 2m or 1h")
    return seconds


def whole(low: int, high: float = math.inf) -> _Whole:
    """An argument type: a whole number from `low` to `high`."""
    return _Whole(low, high)


class _Whole:
    def __init__(self, low: int, high: float) -> None:
        self._low, self._high = low, high

    def __call__(self, text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or not self._low <= value <= self._high:
            span = f"from {self._low} to {self._high}" if math.isfinite(self._high) else f"of at least {self._low}"
            raise argparse.ArgumentTypeError(f"'{text}' is no whole number {span}")
        return value


def build_parser(arguments: list[str]) -> argparse.ArgumentParser:
    """The parser of all commands; `command` is None if none was given.

    Args:
        arguments: what will be parsed; the laboratory is asked for its arguments only if they name it.
    """
    parser = OneLineParser(
        prog="run_dgs.py",
        description="Descattering Gaussian splatting: a sharp 3D twin from photos through something that blurs.",
    )
    parser.add_argument("--version", action="version", version=f"dgs {VERSION}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=OneLineParser)
    _add_reconstruct(commands)
    _add_cameras(commands)
    _add_render(commands)
    doctor = commands.add_parser(
        "doctor", help="check this machine", description="Versions, device, and a self-check of the engine."
    )
    _add_machine(doctor)
    _add_stress(commands)
    _add_blend(commands)
    _add_synthesize(commands, asked="synthesize" in arguments[:1])
    _add_compare(commands)
    _add_inspect(commands)
    add_effort_commands(commands, _add_medium, _add_machine, _add_progress)
    _add_measure_psf(commands)
    add_twin_commands(commands, _add_machine, _add_progress)
    return parser


def _defaults(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    parser.formatter_class = argparse.ArgumentDefaultsHelpFormatter
    return parser


def _add_machine(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto", help="where to compute")
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="CPU threads; all cores if not given")


def _add_progress(parser: argparse.ArgumentParser) -> None:
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


def _add_medium(parser: argparse.ArgumentParser) -> None:
    medium = parser.add_argument_group("what blurs the photos")
    medium.add_argument(
        "--psf",
        default="none",
        metavar="PSF",
        help="point spread function: none | gaussian:SIGMA | gaussian:SX,SY,ANGLE (px of the photos as they "
        "are, degrees) | file:PATH (.npy, .tif, .png, .fits) | per-photo:FILE.json (by photo name, '*' for others) | "
        "auto (reconstruct only: told from the photos) | auto-each (and each photo's own width around it)",
    )
    medium.add_argument(
        "--blur-space",
        choices=("srgb", "linear"),
        default="srgb",
        help="whether the blur acts on the photos' sRGB values or on linear light",
    )


def _add_photos(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "photos", type=Path, metavar="PHOTOS", help="folder of photos, a list of them (.txt, one a line), or a movie"
    )
    parser.add_argument(
        "--frames",
        type=whole(3),
        default=DEFAULT_FRAMES,
        metavar="N",
        help="of a movie, use at most N frames: the sharpest of N equal stretches",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for all results")


def _add_cameras(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    parser = _defaults(
        commands.add_parser(
            "cameras",
            help="only find the cameras",
            description="Finds the cameras and writes DIR/cameras, which 'reconstruct --resume' goes on from.",
        )
    )
    _add_photos(parser)
    _add_medium(parser)
    parser.add_argument("--masks", type=Path, metavar="DIR", help="images of the same names; black pixels do not count")
    parser.add_argument(
        "--max-size", type=whole(16), metavar="PIXELS", help="shrink photos to this longer side, with cameras and PSF"
    )
    _add_machine(parser)
    _add_progress(parser)


def _add_reconstruct(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    parser = _defaults(
        commands.add_parser(
            "reconstruct",
            help="photos in, sharp twin out",
            description="Finds the cameras, fits sharp Gaussians that explain the blurred photos, and writes "
            "twin.ply, cameras/, renders/, report.html and report.json.",
        )
    )
    _add_photos(parser)
    _add_medium(parser)
    parser.add_argument(
        "--effects",
        default="none",
        metavar="EFFECTS",
        help="besides the blur: auto (what the photos call for and a short trial confirms) | none | all | names with "
        "commas out of haze, defocus, field_blur, motion, vignetting, exposure, saturation (auto,haze forces one on, "
        "auto,-haze off)",
    )
    data = parser.add_argument_group("what is given")
    data.add_argument(
        "--cameras",
        type=Path,
        metavar="MODEL",
        help="known cameras: folder of a COLMAP model or a transforms.json; found from the photos if not given",
    )
    data.add_argument("--truth", type=Path, metavar="DIR", help="sharp photos of the same names, only for scoring")
    data.add_argument("--masks", type=Path, metavar="DIR", help="images of the same names; black pixels do not count")
    data.add_argument(
        "--holdout-every",
        type=whole(0),
        default=8,
        metavar="N",
        help="keep views 0, N, 2N ... by sorted name out of the training to score them; 0 keeps none out",
    )
    data.add_argument(
        "--max-size", type=whole(16), metavar="PIXELS", help="shrink photos to this longer side, with cameras and PSF"
    )
    add_refinement(data)
    effort = parser.add_argument_group("effort")
    effort.add_argument(
        "--preset", choices=("draft", "balanced", "fine"), default="balanced", help="how much time to spend"
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
    effort.add_argument("--resume", action="store_true", help="go on from the checkpoint in DIR")
    effort.add_argument(
        "--snapshots",
        action="store_true",
        help="now and then write the twin so far and a picture of it to DIR/snapshot",
    )
    _add_machine(parser)
    _add_progress(parser)


def _add_render(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    parser = _defaults(
        commands.add_parser(
            "render", help="images of a twin", description="Renders a twin from the cameras of a model."
        )
    )
    parser.add_argument("twin", type=Path, metavar="TWIN.ply", help="3DGS PLY")
    parser.add_argument(
        "--cameras", type=Path, required=True, metavar="MODEL", help="folder of a COLMAP model or a transforms.json"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for NAME.png")
    parser.add_argument("--psf", default="none", metavar="PSF", help="also blur, as in 'reconstruct'")
    parser.add_argument("--blur-space", choices=("srgb", "linear"), default="srgb", help="where the blur acts")
    _add_machine(parser)
    _add_progress(parser)


def _add_blend(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    parser = commands.add_parser(
        "blend", help="a .blend of a twin", description="Writes a Blender scene with a twin and its cameras."
    )
    parser.add_argument("twin", type=Path, metavar="TWIN.ply", help="3DGS PLY")
    parser.add_argument(
        "--cameras",
        type=Path,
        metavar="MODEL",
        help="folder of a COLMAP model or a transforms.json; one is placed if not given",
    )
    parser.add_argument("--photos", type=Path, metavar="DIR", help="photos to show behind the cameras")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.blend", help="the scene to write")


def _add_synthesize(commands: argparse._SubParsersAction[OneLineParser], asked: bool) -> None:
    parser = _defaults(
        commands.add_parser(
            "synthesize",
            help="make a test set with Blender",
            description="Renders photos of a known object with Blender, blurred and sharp, with their cameras.",
        )
    )
    if not asked:
        return
    from ..dgs_addon.laboratory.command import add_arguments

    add_arguments(parser)
    if not any(action.dest == "progress" for action in parser._actions):
        _add_progress(parser)


def _add_stress(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    from .stress_command import add_arguments

    parser = _defaults(
        commands.add_parser(
            "stress",
            help="hard cases on this machine",
            description="Runs every known hard case (poison, needles, giants, ties, wide blurs, rails, damaged files) "
            "on this machine and device; a line each with its error and what is allowed. Ends with 2 if one fails.",
        )
    )
    add_arguments(parser)
    _add_machine(parser)


def _add_compare(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    from .compare_command import add_arguments

    parser = _defaults(
        commands.add_parser(
            "compare",
            help="ways to a sharp twin, scored against the truth",
            description="Trains twins from the same blurred photos in several ways (plain, Wiener or Richardson-Lucy "
            "first, the paper's loss, DGS, and from the sharp photos) and scores them against the sharp photos.",
        )
    )
    add_arguments(parser)
    _add_machine(parser)
    _add_progress(parser)


def _add_measure_psf(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    from .measure_psf_command import add_arguments

    parser = _defaults(
        commands.add_parser(
            "measure-psf",
            help="the point spread from a calibration photo",
            description="Measures what the medium does to a point of light, from a photo of one (pinhole, star, bead) "
            "or of a slanted edge (ISO 12233); writes a kernel for --psf file:KERNEL.tif with a picture beside it.",
        )
    )
    add_arguments(parser)
    _add_progress(parser)


def _add_inspect(commands: argparse._SubParsersAction[OneLineParser]) -> None:
    from .inspect_command import add_arguments

    parser = _defaults(
        commands.add_parser(
            "inspect",
            help="which effects the photos show",
            description="Looks for blur, defocus, motion, haze, differing exposure, vignetting, noise, clipping and "
            "gloss in the photos, before anything is trained: size, uncertainty and evidence of each.",
        )
    )
    add_arguments(parser)
    _add_machine(parser)
    _add_progress(parser)
