"""Photos as they would be without what lens and sensor did: undone once, so that it costs the training nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from ...effects.spec import Switch
from ...imaging.formation.chain import Formation
from ...imaging.formation.effect import Shot
from ...views import View


def corrected(views: Sequence[View], formation: Formation, masked: Sequence[Switch] = ()) -> list[View]:
    """The views that the twin is fitted to; the very same ones where nothing is on.

    Args:
        formation: its effects of the sensor are undone, in 16 bit. Px that become brighter than white, because
            their photo was darker than the others, are masked.
        masked: effects whose px do not count.
    """
    if not formation.sensor and not masked:
        return list(views)
    return [_one(view, formation, masked) for view in views]


def _one(view: View, formation: Formation, masked: Sequence[Switch]) -> View:
    top = int(np.iinfo(view.photo.dtype).max)
    levels = view.levels or top
    mask = np.ones(view.photo.shape[:2], bool) if view.mask is None else view.mask.copy()
    for effect in masked:
        assert effect.counts is not None
        mask &= effect.counts(view.photo, levels)
    photo = view.photo
    if formation.sensor:
        camera = view.camera
        shot = Shot(view.name, camera.height, camera.width, middle=(camera.cx, camera.cy))
        clear = formation.unfiled(torch.from_numpy(view.planes()), shot).numpy()
        mask &= (clear <= 1.0).all(axis=0)
        photo = np.ascontiguousarray(np.round(clear.clip(0.0, 1.0) * 65535.0).astype(np.uint16).transpose(1, 2, 0))
    return replace(view, photo=photo, mask=None if mask.all() else mask, levels=levels)
