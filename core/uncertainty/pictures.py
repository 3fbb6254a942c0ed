"""Shows the suggested views as the twin shows them now, and how wrong that is expected to be."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from torch import Tensor

from ..files import make_folder
from ..photos.write import write_png
from ..report.known import PredictedView, hatched, painted


def draw_expected(
    folder: Path, views: Mapping[str, tuple[Tensor, Tensor, Tensor]], contrast: float
) -> list[PredictedView]:
    """Writes NAME.png per view: the twin's sharp view | with guessed parts hatched | its expected error in colours.

    Args:
        views: by name, as in `Ranking`. Pictures of other views are removed.
        contrast: of the photos, rms, sRGB.

    Returns:
        The same for the report.

    Raises:
        OutputError: the folder cannot be written.
    """
    make_folder(folder)
    for old in folder.glob("*.png"):
        old.unlink()
    out = []
    for order, (name, (sharp, deviation, observed)) in enumerate(views.items(), start=1):
        image = np.round(sharp.numpy().clip(0.0, 1.0).transpose(1, 2, 0) * 255.0).astype(np.uint8)
        view = PredictedView(name, order, image, deviation.numpy() / max(contrast, 1e-6), observed.numpy())
        panels = np.concatenate([view.image, hatched(view), painted(view.error)], axis=1)
        write_png(folder / f"{Path(name).stem}.png", np.ascontiguousarray(panels))
        out.append(view)
    return out
