"""A kernel of each photo's own, where neither a path of the camera nor a lens explains its blur."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..imaging.formation.kernels import PhotoKernels
from ..inspection.evidence import Evidence, unknown
from .spec import EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


def inspect(photos: PhotoSet) -> Evidence:
    """Nothing: any blur is some kernel, so only what a kernel explains better than all else speaks for one."""
    return unknown("kernels", "px", 1.0, "Not measured: any blur is some kernel")


def build(photos: PhotoSet) -> PhotoKernels | None:
    """Kernels to be learned, of held-out photos too; None without cameras."""
    return None if photos.cameras is None else PhotoKernels.sharp(sorted(photos.cameras.poses))


SPEC = EffectSpec(
    name="kernels",
    physics=PhotoKernels.physics,
    words=EffectWords(
        label="Free Kernels",
        tooltip="A blur of any shape that is the same all over a photo, and another one in the next, learned with the "
        "twin: where neither the camera's motion nor a focus explains it",
        simulated="A free kernel of each photo, learned with the twin.",
        missing="Blur that changes from photo to photo",
        blurred="blurred, each in its own way",
        covered_by_own_blurs=True,
    ),
    inspect=inspect,
    switch=Switch(
        speakers=("kernels",), trial_rank=9, simulation=PhotoKernels, build=build, may_be_absent=True, by_name_only=True
    ),
)
