"""Shows the suggested views as the twin shows them now, and how wrong that is expected to be."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from torch import Tensor

from ..files import make_folder
from ..pipeline.heldout import write_png

#: Expected rms error (sRGB) that is drawn in full colour.
FULL = 0.15
RED = np.array([200.0, 30.0, 30.0])


def draw_expected(folder: Path, views: Mapping[str, tuple[Tensor, Tensor]]) -> None:
    """Writes NAME.png per view: the twin's sharp view | its expected error, white for none, red for 0.15 and more.

    Args:
        views: by name, [3, H, W] sRGB and [H, W] expected rms error. Pictures of other views are removed.

    Raises:
        OutputError: the folder cannot be written.
    """
    make_folder(folder)
    for old in folder.glob("*.png"):
        old.unlink()
    for name, (sharp, deviation) in views.items():
        shown = np.round(sharp.numpy().clip(0.0, 1.0).transpose(1, 2, 0) * 255.0)
        strength = np.clip(deviation.numpy() / FULL, 0.0, 1.0)[:, :, None]
        wrong = np.round(255.0 - strength * (255.0 - RED))
        panels = np.concatenate([shown, wrong], axis=1).astype(np.uint8)
        write_png(folder / f"{Path(name).stem}.png", np.ascontiguousarray(panels))
