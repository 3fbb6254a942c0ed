"""A job that renders a test set, and the scene's settings that go with it: photos with a known truth.

Cycles renders a ball whose shape is known to the millimetre. A Blender without a window does it, so that the
open file is left alone and the window stays alive.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DgsError
from ..engine.process import RUN
from ..laboratory.media.registry import MEDIA, medium_of
from ..paths import absolute
from ..scene.medium import ESTIMATED_FROM_PHOTOS, psf_argument
from .request import Request

#: Height of a photo as a share of its width.
_HEIGHT = 2 / 3
#: Paths per pixel where nothing takes their noise away.
_UNDENOISED = 64


def test_set_request(settings: Any) -> Request:
    """The job that renders the set which `scene.dgs` describes.

    Raises:
        DgsError: no folder is chosen, or the medium is incomplete or makes no sense.
    """
    out = absolute(settings.test_set)
    if out is None:
        raise DgsError("No folder for the test set is chosen", "Choose one in step 6")
    width = settings.test_width
    arguments = [
        "synthesize",
        "--out",
        str(out),
        "--views",
        str(settings.test_views),
        "--path",
        "dome",
        "--size",
        f"{width}x{round(width * _HEIGHT)}",
        *_medium(settings),
        *_samples(),
        "--progress",
        "json",
        "--control",
    ]
    return Request("synthesize", out / "photos", out, arguments, settings.test_views, program=_blender())


def use_test_set(out: Path, settings: Any) -> None:
    """Steps 1, 2 and 6 take over a finished set: its photos, its true cameras and its sharp photos."""
    settings.photos, settings.out, settings.masks = str(out / "photos"), "", ""
    settings.cameras, settings.model = "model", str(out / "cameras")
    settings.truth = str(out / "sharp")


def is_to_be_found(settings: Any) -> bool:
    """Whether step 3 leaves the medium to the photos: the set is then blurred by a Gaussian, for the run to find."""
    return settings.test_medium == "psf" and settings.medium in ESTIMATED_FROM_PHOTOS


def _medium(settings: Any) -> list[str]:
    """The medium of step 3, or one that Cycles renders."""
    spec = next((spec for spec in MEDIA if spec.name == settings.test_medium), None)
    if spec is None:
        psf = f"gaussian:{settings.sigma:g}" if is_to_be_found(settings) else psf_argument(settings)
        return ["--psf", psf, "--blur-space", settings.blur_space]
    text = f"{spec.name}:{settings.test_values.strip() or spec.usual}"
    differs = not medium_of(text).every_photo and settings.test_sharp > 0
    return ["--medium", text, *(["--sharp-share", f"{settings.test_sharp:g}"] if differs else [])]


def _samples() -> list[str]:
    """Some builds of Blender have no denoiser; more paths per pixel do instead."""
    cycles = getattr(bpy.context.scene, "cycles", None)
    return [] if cycles is None or cycles.denoiser else ["--no-denoise", "--samples", str(_UNDENOISED)]


def _blender() -> tuple[str, ...]:
    if getattr(bpy.app, "module", False):  # pip's bpy
        return (sys.executable, str(RUN))
    return (bpy.app.binary_path, "-b", "--factory-startup", "-P", str(RUN), "--")
