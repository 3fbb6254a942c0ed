"""`run_dgs.py synthesize`: its arguments, and the call."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.progress import Progress
from .media.registry import forms
from .settings import BACKGROUNDS, FEWEST_THROUGH_MEDIA, PATH_NAMES, SCENES, SynthesizeSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds everything that `SynthesizeSettings` holds, and where to write."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write the data set into")
    parser.add_argument(
        "--frames",
        type=_frames,
        metavar="A-B",
        help="render only photos A to B (from 0), as one of several processes or machines that share DIR; the same "
        "without it finishes the set",
    )
    usual = SynthesizeSettings()
    _add_scene(parser.add_argument_group("what is seen, and from where"), usual)
    _add_render(parser.add_argument_group("how it is rendered"), usual)
    _add_medium(parser.add_argument_group("the medium"), usual)
    _add_lens_and_motion(parser.add_argument_group("lens and motion"), usual)
    _add_sensor(parser.add_argument_group("sensor and files"), usual)
    _add_truth(parser.add_argument_group("what is written besides"))


def _add_scene(group: argparse._ArgumentGroup, usual: SynthesizeSettings) -> None:
    add = group.add_argument
    scenes = f"{', '.join(SCENES)}, or FILE.blend with its own lights and materials"
    add("--scene", default=usual.scene, metavar="SCENE", help=scenes)
    formats = "an object instead of the ball: OBJ, PLY, STL, glTF, USD, FBX"
    add("--mesh", default=usual.mesh, metavar="FILE", help=formats)
    add("--path", choices=PATH_NAMES, default=usual.path, help="where the cameras stand; scene: the .blend's own")
    behind = "nothing behind the object: photos with alpha, or white; the table is left out"
    add("--background", choices=BACKGROUNDS, default=usual.background, help=behind)
    add("--views", type=int, default=usual.views, help="number of photos")
    add("--size", type=_size, default=(usual.width, usual.height), metavar="WxH", help="frame in pixels")


def _add_render(group: argparse._ArgumentGroup, usual: SynthesizeSettings) -> None:
    add = group.add_argument
    add("--samples", type=int, default=usual.samples, help="Cycles' paths per pixel")
    add("--no-denoise", dest="denoise", action="store_false", help="leave the render as it is traced")
    beyond = f"rendered beyond each side ({usual.overscan}; with --medium 0)"
    add("--overscan", type=int, metavar="PX", help=beyond)
    add("--seed", type=int, default=usual.seed, help="of everything that is random")


def _add_medium(group: argparse._ArgumentGroup, usual: SynthesizeSettings) -> None:
    add = group.add_argument
    add("--medium", action="append", dest="media", metavar="NAME:VALUES", help=f"rendered, once for each: {forms()}")
    share = "share of photos without shake and defocus, besides those held out"
    add("--sharp-share", type=float, default=usual.sharp_share, metavar="SHARE", help=share)
    every = "views 0, N, 2N ... have neither shake nor defocus; 0: none"
    add("--holdout-every", type=int, default=usual.holdout_every, metavar="N", help=every)
    paths = f"paths per pixel of photos through media; 0: as --samples, at least {FEWEST_THROUGH_MEDIA}"
    add("--medium-samples", type=int, default=usual.medium_samples, metavar="N", help=paths)
    forms_of_psf = "none, gaussian:SIGMA, gaussian:SX,SY,ANGLE, disk:RADIUS or file:PATH"
    add("--psf", help=f"{forms_of_psf} ({usual.psf}; with --medium none)")
    add("--blur-space", choices=("srgb", "linear"), default=usual.blur_space, help="where the blur acts")
    fog = "rendered fog: how often light is scattered per metre"
    add("--fog", type=float, default=usual.fog, metavar="PER_METRE", help=fog)
    towards = "-0.99 scatters back, 0 evenly, 0.99 on"
    add("--fog-anisotropy", type=float, default=usual.fog_anisotropy, metavar="G", help=towards)


def _add_lens_and_motion(group: argparse._ArgumentGroup, usual: SynthesizeSettings) -> None:
    add = group.add_argument
    stop = "f-number of a rendered lens: depth of field; a pinhole if not given"
    add("--aperture", type=float, default=usual.aperture, metavar="N", help=stop)
    add("--focus", type=float, default=usual.focus, metavar="METRES", help="depth that is sharp; the object's middle")
    way = "way of the camera along its path during each exposure"
    add("--camera-motion", type=float, default=usual.camera_motion, metavar="MM", help=way)
    way = "way of the object in mm during each exposure, Blender's axes"
    add("--object-motion", type=_motion, default=usual.object_motion, metavar="X,Y,Z", help=way)


def _add_sensor(group: argparse._ArgumentGroup, usual: SynthesizeSettings) -> None:
    add = group.add_argument
    drift = "largest change of exposure over the photos, up or down"
    add("--exposure-drift", type=float, default=usual.exposure_drift, metavar="STOPS", help=drift)
    curve = "the camera's own curve, of photos and sharp pictures: s:POWER, or film:STRENGTH as of phones"
    add("--contrast", default=usual.contrast, metavar="CURVE", help=curve)
    add("--noise", type=float, default=usual.noise, help="standard deviation on encoded values in [0, 1]")
    white = "count photons: electrons that white is (shot noise)"
    add("--full-well", type=float, default=usual.full_well, metavar="ELECTRONS", help=white)
    add("--read-noise", type=float, default=usual.read_noise, metavar="ELECTRONS", help="rms of reading the sensor")
    add("--bits", type=int, choices=(8, 16), default=usual.bits, help="bits per channel")
    add("--jpeg", type=int, default=usual.jpeg, metavar="QUALITY", help="compress the photos, 1 to 100")


def _add_truth(group: argparse._ArgumentGroup) -> None:
    add = group.add_argument
    add("--masks", action="store_true", help="where the ball is seen")
    add("--depth", action="store_true", help="depth maps")
    add("--normals", action="store_true", help="normal maps")
    add("--keep-linear", action="store_true", help="float renders, to try other media without rendering")


def settings_of(args: argparse.Namespace) -> SynthesizeSettings:
    """The settings that the parsed arguments ask for: where Cycles renders the medium, nothing is convolved unasked."""
    usual = SynthesizeSettings(psf="none", overscan=0) if args.media else SynthesizeSettings()
    return SynthesizeSettings(
        scene=args.scene,
        path=args.path,
        views=args.views,
        width=args.size[0],
        height=args.size[1],
        psf=usual.psf if args.psf is None else args.psf,
        blur_space=args.blur_space,
        bits=args.bits,
        noise=args.noise,
        overscan=usual.overscan if args.overscan is None else args.overscan,
        samples=args.samples,
        denoise=args.denoise,
        seed=args.seed,
        masks=args.masks,
        depth=args.depth,
        keep_linear=args.keep_linear,
        mesh=args.mesh,
        exposure_drift=args.exposure_drift,
        normals=args.normals,
        aperture=args.aperture,
        focus=args.focus,
        camera_motion=args.camera_motion,
        object_motion=args.object_motion,
        fog=args.fog,
        fog_anisotropy=args.fog_anisotropy,
        full_well=args.full_well,
        read_noise=args.read_noise,
        jpeg=args.jpeg,
        background=args.background,
        media=tuple(args.media or ()),
        sharp_share=args.sharp_share,
        holdout_every=args.holdout_every,
        medium_samples=args.medium_samples,
        contrast=args.contrast,
    )


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Makes the data set and returns the exit status; errors are `DgsError`s."""
    from .dataset import synthesize  # late: heavy (numpy, files), and `--help` needs none of it

    synthesize(settings_of(args), args.out, progress, args.frames)
    return 0


def _frames(text: str) -> range:
    first, dash, last = text.partition("-")
    try:
        wanted = range(int(first), int(last if dash else first) + 1)
    except ValueError:
        wanted = range(0)
    if not wanted:
        raise argparse.ArgumentTypeError(f"'{text}' is no range of photos; write the first and the last as 0-9")
    return wanted


def _motion(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no motion; write millimetres as X,Y,Z") from None
    return x, y, z


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}' is no size; write WIDTHxHEIGHT, such as 800x533")
    return int(width), int(height)
