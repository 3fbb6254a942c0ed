"""Cameras that a training adjusted: they stand beside the twin in the place of those that were found.

The twin fits them, and whoever looks from a photo's camera, exports it or measures goes by them. A run that is resumed
goes on from what was found, as its checkpoint does.
"""

from __future__ import annotations

from dataclasses import replace

from ..imaging.formation.chain import Formation
from ..imaging.formation.motion import motion_of
from ..reconstruction import Reconstruction
from ..training.run import Trained
from ..twin.folder import TwinFolder


def keep_adjusted(found: Reconstruction, trained: Trained, folder: TwinFolder) -> Formation:
    """Writes cameras where the training says that they were on average, if it adjusted them.

    Returns:
        The effects, paths counted from the cameras that are in the folder then.

    Raises:
        OutputError: they cannot be written.
    """
    motion = motion_of(trained.formation.effects)
    if motion is None or not trained.counters.get("cameras adjusted"):
        return trained.formation
    focals = {name: lens.fx for name, lens in found.lenses.items()}
    poses = {name: motion.mean_pose(name, pose, focals[name]) for name, pose in found.poses.items()}
    folder.save_adjusted(found, replace(found, poses=poses))
    moved = motion.from_means(focals)
    return Formation([moved if effect is motion else effect for effect in trained.formation.effects])
