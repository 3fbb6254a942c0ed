"""Exposures of a twin's photos: those that its training learned, undone on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ..errors import FormatError
from ..forward.unfiled import unfiled_planes
from ..imaging.formation.chain import Formation
from ..imaging.formation.effect import Shot
from ..imaging.formation.exposure import Exposure
from ..json_shape import check_shape, number
from ..views import View


def learned_exposure(report: Mapping[str, Any]) -> Exposure | None:
    """The exposures that a twin's report holds; None where its training learned none.

    Raises:
        FormatError: they are damaged.
    """
    rows = [row for row in report.get("effects", ()) if isinstance(row, dict) and row.get("on")]
    row = next((row for row in rows if row.get("name") == Exposure.name), None)
    if row is None:
        return None
    gains: Any = row.get("parameters")
    try:
        check_shape(gains, {"*": [number]})
        if not all(len(g) == 3 and min(g) > 0 for g in gains.values()):
            raise ValueError("a gain is not three numbers above 0")
    except ValueError as error:
        raise FormatError(
            f"The exposures in report.json are damaged ({error})", "Reconstruct the twin again"
        ) from error
    return Exposure(list(gains), torch.tensor(list(gains.values()), dtype=torch.float32).reshape(-1, 3).log())


def without_exposure(views: Sequence[View], exposure: Exposure | None) -> list[View]:
    """The views as they would be at the twin's own exposure, in 16 bit; those that it does not name as they are."""
    if exposure is None:
        return list(views)
    named, formation = set(exposure.names), Formation([exposure])
    return [_unfiled(view, formation) if view.name in named else view for view in views]


def _unfiled(view: View, formation: Formation) -> View:
    camera = view.camera
    shot = Shot(view.name, camera.height, camera.width, middle=(camera.cx, camera.cy))
    planes = unfiled_planes(view, formation, shot).clip(0.0, 1.0)
    photo = np.ascontiguousarray(np.round(planes * 65535.0).astype(np.uint16).transpose(1, 2, 0))
    levels = view.levels or int(np.iinfo(view.photo.dtype).max)
    alpha = view.alpha
    if alpha is not None and alpha.dtype == np.uint8:
        alpha = alpha.astype(np.uint16) * np.uint16(257)
    return replace(view, photo=photo, levels=levels, alpha=alpha)
