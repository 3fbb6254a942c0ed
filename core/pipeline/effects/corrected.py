"""Photos as they would be without what lens and sensor did: undone once, so that it costs the training nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from ...background import Background
from ...compositing import over_another
from ...effects.spec import Switch
from ...forward.unfiled import unfiled_planes
from ...imaging.formation.chain import Formation
from ...imaging.formation.effect import Shot
from ...imaging.formation.exposure import Exposure
from ...photos.empty import background_shows
from ...photos.store import kept_beside
from ...views import View


def corrected(views: Sequence[View], formation: Formation, masked: Sequence[Switch] = ()) -> list[View]:
    """The views that the twin is fitted to; the very same ones where nothing is on.

    Args:
        formation: its effects of the sensor are undone, in 16 bit. Px that become brighter than white, because
            their photo was darker than the others, are masked; where exposures are learned they are white, as the
            training asks what may be clipped.
        masked: effects whose px do not count.
    """
    if not formation.sensor and not masked:
        return list(views)
    return [_one(view, formation, masked) for view in views]


def _one(view: View, formation: Formation, masked: Sequence[Switch]) -> View:
    top = int(np.iinfo(view.photo.dtype).max)
    levels = view.levels or top
    mask = np.ones(view.photo.shape[:2], bool) if view.mask is None else view.mask.copy()
    shows = background_shows(view)
    behind = np.zeros(mask.shape, bool) if shows is None else shows  # white is no clipped highlight there
    for effect in masked:
        assert effect.counts is not None
        mask &= effect.counts(view.photo, levels) | behind
    photo = view.photo
    if formation.sensor:
        camera = view.camera
        shot = Shot(view.name, camera.height, camera.width, middle=(camera.cx, camera.cy))
        clear = unfiled_planes(view, formation, shot)
        learned = any(isinstance(effect, Exposure) for effect in formation.sensor)
        within = np.ones_like(mask) if learned else (clear <= 1.0).all(axis=0)
        mask &= within | behind
        photo = np.ascontiguousarray(np.round(clear.clip(0.0, 1.0) * 65535.0).astype(np.uint16).transpose(1, 2, 0))
        if view.alpha is not None and view.alpha.dtype == np.uint8:
            view = replace(view, alpha=view.alpha.astype(np.uint16) * np.uint16(257))
    counting = None if mask.all() else kept_beside(view.photo, mask)
    alpha = None if view.alpha is None else kept_beside(view.photo, view.alpha)
    return replace(view, photo=kept_beside(view.photo, photo), mask=counting, levels=levels, alpha=alpha)


def over_filed(
    photo: NDArray[np.float32],
    empty: NDArray[np.float32] | None,
    background: Background | None,
    formation: Formation,
    shot: Shot,
) -> NDArray[np.float32]:
    """A photo as it was filed, over the background as the camera would have filed it: what a filed render is.

    Args:
        photo: [3, H, W] sRGB, over `background`; empty: [H, W], 1 - alpha, or None.
    """
    if empty is None or background is None or not formation.sensor:
        return photo
    colour = torch.tensor(background.colour)[:, None, None].expand(3, *empty.shape)
    return over_another(background, photo, empty, formation.filed(colour, shot).numpy())
