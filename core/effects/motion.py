"""Motion of the camera while the shutter was open: a path of every photo's own, learned with the twin."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..imaging.formation.motion import CameraMotion, straight_paths
from ..inspection.evidence import Evidence, judged, unknown
from .spec import EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


def inspect(photos: PhotoSet) -> Evidence:
    """The camera's own movement during the exposures."""
    from ..inspection.motion_paths import SETTINGS as PATHS  # heavy: scipy

    moved = photos.motion
    if moved is None:
        return unknown("motion", "px", PATHS.smallest_visible, "Not measured: four photos with detail are needed")
    lengths = moved.lengths
    worst = max(lengths, key=lambda name: lengths[name])
    text = f"Paths of {moved.length:.1f} px (rms) of the photos' own, the longest {lengths[worst]:.1f} px in {worst}"
    if lengths[worst] == 0.0:
        text = "No photo has a path of its own that stands clear of its noise"
    evidence = judged("motion", moved.length, moved.error, PATHS.smallest_visible, "px", text)
    evidence.plots.update(lengths=lengths, paths=moved.paths)
    return evidence


def build(photos: PhotoSet) -> CameraMotion | None:
    """Paths to begin with, of held-out photos too, as long as a photo's spectrum shows; None without cameras."""
    from ..inspection.motion_paths import MotionPath  # heavy: scipy

    paths, cameras = photos.motion_paths, photos.cameras
    if cameras is None:
        return None
    ways = {}
    for name in sorted(cameras.poses):
        path, focal = paths.get(name, MotionPath()), cameras.lenses[name].fx
        angle = math.radians(path.angle)
        ways[name] = path.length * math.cos(angle) / focal, path.length * math.sin(angle) / focal
    return straight_paths(ways, 1)


SPEC = EffectSpec(
    name="motion",
    physics=CameraMotion.physics,
    words=EffectWords(
        label="Camera Motion",
        tooltip="A camera that moved along a path of its own during each exposure, learned with the twin",
        simulated="Motion of the camera during each exposure: each photo's own path, learned with the twin.",
        missing="Blur that changes from photo to photo",
        blurred="shaken",
        covered_by_own_blurs=True,
    ),
    inspect=inspect,
    switch=Switch(speakers=("motion",), trial_rank=7, simulation=CameraMotion, build=build, may_be_absent=True),
)
