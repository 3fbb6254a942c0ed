"""Pictures of a twin's photos that markers are sought on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ..colour import linear_to_srgb, srgb_to_linear
from ..sfm.sharpen import LUMA, wiener
from ..twin.opened import OpenedTwin
from .sights import Sights

Floats = NDArray[np.float32]

#: Kinds of pictures, in words, in the order in which they are tried.
PICTURES: Mapping[str, str] = {
    "photos": "as they are",
    "sharpened": "sharpened by their own blur",
    "renders": "as the twin renders them, sharp",
}


def pictures_of(kind: str, twin: OpenedTwin, views: Sights) -> Iterator[tuple[str, Floats]]:
    """Name and [H, W] grey as displayed, for each camera; no sharpened photos where no photo is blurred."""
    if kind == "sharpened" and not twin.medium.blurs:
        return
    by_name = {view.name: view for view in twin.views}
    for name, sight in views.views.items():
        if kind == "renders":
            yield name, _grey(sight.image)
        elif kind == "sharpened":
            yield name, _sharpened(_grey(by_name[name].planes()), name, twin)
        else:
            yield name, _grey(by_name[name].planes())


def _grey(planes: Floats) -> Floats:
    return np.tensordot(np.array(LUMA, np.float32), planes, axes=1)


def _sharpened(grey: Floats, name: str, twin: OpenedTwin) -> Floats:
    psf = twin.medium.psf_for(name)
    if psf is None or psf.is_identity:
        return grey
    if twin.medium.blur_space == "linear":
        light = wiener(np.asarray(srgb_to_linear(grey), np.float32), psf.kernel())
        return np.asarray(linear_to_srgb(np.clip(light, 0.0, 1.0)), np.float32)
    return wiener(grey, psf.kernel())
