"""`run_dgs.py synthesize`: its arguments, and the call."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.progress import Progress
from . import synthesize
from .settings import PATH_NAMES, SCENES, SynthesizeSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds everything that `SynthesizeSettings` holds, and where to write."""
    usual = SynthesizeSettings()
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write the data set into")
    add("--scene", default=usual.scene, metavar="SCENE",
        help=f"{', '.join(SCENES)}, or FILE.blend with its own lights and materials")  # fmt: skip
    add("--mesh", default=usual.mesh, metavar="FILE",
        help="an object instead of the ball: OBJ, PLY, STL, glTF, USD, FBX")  # fmt: skip
    add("--path", choices=PATH_NAMES, default=usual.path, help="where the cameras stand; scene: the .blend's own")
    add("--views", type=int, default=usual.views, help="number of photos")
    add("--size", type=_size, default=(usual.width, usual.height), metavar="WxH", help="frame in pixels")
    add("--psf", default=usual.psf, help="none, gaussian:SIGMA, gaussian:SX,SY,ANGLE, disk:RADIUS or file:PATH")
    add("--blur-space", choices=("srgb", "linear"), default=usual.blur_space, help="where the blur acts")
    add("--bits", type=int, choices=(8, 16), default=usual.bits, help="bits per channel")
    add("--noise", type=float, default=usual.noise, help="standard deviation on encoded values in [0, 1]")
    add("--overscan", type=int, default=usual.overscan, metavar="PX", help="rendered beyond each side")
    add("--samples", type=int, default=usual.samples, help="Cycles' paths per pixel")
    add("--no-denoise", dest="denoise", action="store_false", help="leave the render as it is traced")
    add("--seed", type=int, default=usual.seed)
    add("--masks", action="store_true", help="also write where the ball is seen")
    add("--depth", action="store_true", help="also write depth maps")
    add("--normals", action="store_true", help="also write normal maps")
    add("--exposure-drift", type=float, default=usual.exposure_drift, metavar="STOPS",
        help="largest change of exposure over the photos, up or down")  # fmt: skip
    add("--keep-linear", action="store_true", help="keep float renders, to try other media without rendering")


def settings_of(args: argparse.Namespace) -> SynthesizeSettings:
    """The settings that the parsed arguments ask for."""
    return SynthesizeSettings(
        scene=args.scene, path=args.path, views=args.views, width=args.size[0], height=args.size[1],
        psf=args.psf, blur_space=args.blur_space, bits=args.bits, noise=args.noise, overscan=args.overscan,
        samples=args.samples, denoise=args.denoise, seed=args.seed, masks=args.masks, depth=args.depth,
        keep_linear=args.keep_linear, mesh=args.mesh, exposure_drift=args.exposure_drift, normals=args.normals,
    )  # fmt: skip


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Makes the data set and returns the exit status; errors are `DgsError`s."""
    synthesize(settings_of(args), args.out, progress)
    return 0


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}' is no size; write WIDTHxHEIGHT, such as 800x533")
    return int(width), int(height)
