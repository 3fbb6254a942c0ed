"""Pictures of an update: each new photo, how it differs from the twin, and which px changed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..files import make_folder
from ..photos.write import write_png
from ..views import View
from .changes import Changes

#: Residual (sRGB values in [0, 1]) that is drawn in full colour.
FULL = 0.15


def draw_changes(folder: Path, views: Sequence[View], changes: Changes, step: int) -> None:
    """Writes NAME.png per new photo: photo | residual (red: brighter now, blue: darker) | what changed.

    In the last one changes are red, and what looks changed but was in no old photo is green.

    Raises:
        OutputError: the folder cannot be written.
    """
    make_folder(folder)
    for view in views:
        residual, changed = changes.residuals[view.name], changes.changed[view.name]
        height, width = residual.shape
        full = np.iinfo(view.photo.dtype).max
        photo = np.round(view.photo / full * 255.0).astype(np.uint8)
        photo = np.asarray(Image.fromarray(photo).resize((width, height), Image.Resampling.BOX))
        strength = np.clip(residual / FULL, -1.0, 1.0)[:, :, None]
        red, green, blue = (np.array(c, float) for c in ((200, 30, 30), (30, 160, 60), (30, 60, 200)))
        shown = 255.0 - np.where(strength > 0, strength * (255.0 - red), -strength * (255.0 - blue))
        grey = photo.mean(axis=2, keepdims=True).repeat(3, axis=2)
        marked = np.where(changed[:, :, None], 0.4 * grey + 0.6 * red, grey)
        marked = np.where(changes.unseen[view.name][:, :, None], 0.7 * grey + 0.3 * green, marked)
        panels = [photo, shown.astype(np.uint8), marked.astype(np.uint8)]
        write_png(folder / f"{Path(view.name).stem}.png", np.ascontiguousarray(np.concatenate(panels, axis=1)))
