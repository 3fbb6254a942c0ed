"""What a training looks like so far: a picture and the twin, for whoever watches it."""

from __future__ import annotations

import io
import time
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from ..forward import sharp_view
from ..photos.scale import resized, size_within
from ..photos.write import png_bytes
from ..twin.folder import TwinFolder
from .views import to_pixels

if TYPE_CHECKING:
    from ..training.trainer import Trainer

#: Longest side in px of the preview: whoever shows it need neither decode nor shrink it.
PREVIEW_SIZE = 360
#: Seconds between two snapshots at least.
INTERVAL = 2.0
#: Seconds between two twins that are kept beside the checkpoint.
TWIN_INTERVAL = 25.0
#: Snapshots take at most this share of the time.
SHARE = 0.04


class Snapshots:
    """Writes snapshot/ now and then: a photo's view of the sharp twin, the same small, and the twin.

    Whoever reads them at any moment finds them whole.

    Raises:
        OutputError: the folder cannot be written to.
    """

    def __init__(self, folder: TwinFolder) -> None:
        self._folder = folder
        self._next = time.perf_counter() + INTERVAL

    def __call__(self, trainer: Trainer) -> None:
        """After an iteration: writes a snapshot if it is time."""
        began = time.perf_counter()
        if began < self._next:
            return
        pixels = to_pixels(_picture(trainer))
        preview = io.BytesIO()
        np.save(preview, resized(pixels, *size_within(pixels.shape[1], pixels.shape[0], PREVIEW_SIZE)))
        self._folder.save_snapshot(png_bytes(pixels), preview.getvalue(), trainer.result().cloud())
        ended = time.perf_counter()
        self._next = ended + max(INTERVAL, (ended - began) / SHARE)


class Watchers:
    """Follows a training: keeps the twin so far as twin.ply, and snapshots if they are wanted.

    Whoever ends the process, however rudely, finds a twin that is half a minute old at most.

    Raises:
        OutputError: the folder cannot be written to.
    """

    def __init__(self, folder: TwinFolder, snapshots: bool) -> None:
        self._folder = folder
        self._snapshots = Snapshots(folder) if snapshots else None
        self._next = time.perf_counter() + TWIN_INTERVAL

    def __call__(self, trainer: Trainer) -> None:
        """After an iteration."""
        if self._snapshots is not None:
            self._snapshots(trainer)
        if time.perf_counter() >= self._next:
            self._folder.save_twin(trainer.result().cloud())
            self._next = time.perf_counter() + TWIN_INTERVAL


def _picture(trainer: Trainer) -> NDArray[np.float32]:
    """[3, H, W] the sharp twin from a photo's place, on the training's finest grid."""
    level = trainer.levels[-1]
    view = (level.heldout or level.views)[0]
    with torch.no_grad():
        settings = trainer.raster_settings(level)
        image = sharp_view(trainer.optimizer.gaussians, view.camera, settings, trainer.background).image
    return image.cpu().numpy()
