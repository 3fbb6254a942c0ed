"""Cameras that a training adjusted: they stand beside the twin in the place of those that were found or given.

The twin fits them, and whoever looks from a photo's camera, exports it or measures goes by them. A run that is resumed
goes on from what there was before, as its checkpoint does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..imaging.formation.chain import Formation
from ..imaging.formation.motion import motion_of
from ..reconstruction import Reconstruction
from ..run_settings import AdjustCameras
from ..training.cameras.adjusting import Adjust
from ..training.run import Trained
from ..twin.folder import TwinFolder


def adjusted(trained: Trained) -> bool:
    """Whether the training moved the cameras."""
    return bool(trained.counters.get("cameras adjusted"))


def adjusts(asked: AdjustCameras, found: bool) -> Adjust:
    """Which cameras a training moves, as it was asked for, and whether they were found in photos."""
    if asked == "auto":
        return "always" if found else "contradicted"
    return asked


def adjustment_said(given: Reconstruction, trained: Trained, asked: AdjustCameras = "auto") -> str | None:
    """What is said of cameras that were given and moved, and why; None where they stayed."""
    motion = motion_of(trained.formation.effects)
    if motion is None or not adjusted(trained):
        return None
    offsets = (motion.offset(name, given.lenses[name].fx) for name in motion.names if name in given.poses)
    moved = [offset for offset in offsets if offset is not None]
    by = f"{np.median(moved):.1f} px in the median, {max(moved):.1f} at most"
    why = "Given cameras"
    if asked == "auto":
        found = given.figures.from_photos
        reason = "were found in such photos" if found else "are contradicted by the photos"
        why = f"The cameras that were given {reason}: they"
    return f"{why} are adjusted with the twin, by {by}. As they were given they lie in cameras/found"


def keep_adjusted(found: Reconstruction, trained: Trained, folder: TwinFolder) -> Formation:
    """Writes cameras where the training says that they were on average, if it adjusted them.

    Returns:
        The effects, paths counted from the cameras that are in the folder then.

    Raises:
        OutputError: they cannot be written.
    """
    motion = motion_of(trained.formation.effects)
    if motion is None or not adjusted(trained):
        return trained.formation
    focals = {name: lens.fx for name, lens in found.lenses.items()}
    poses = {name: motion.mean_pose(name, pose, focals[name]) for name, pose in found.poses.items()}
    folder.save_adjusted(found, replace(found, poses=poses))
    moved = motion.from_means(focals)
    return Formation([moved if effect is motion else effect for effect in trained.formation.effects])
