"""Which px of a photo are empty: from its alpha, or from the plain background that its set shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ..background import Background
from ..compositing import Pixels
from ..views import View
from .load import Photo


def empty_pixels(photo: Photo | View) -> NDArray[np.bool_] | None:
    """[H, W] px through which nothing was seen; None where the photo does not say.

    Where the photo has alpha: those of alpha 0. Where the set shows a plain background: those that do not differ from
    it by more than its noise and hang together with the photo's border. An object's px of the background's very colour
    pass for empty then: let several photos say so before something is taken away. Px that do not count are not empty.
    """
    pixels = photo.pixels if isinstance(photo, Photo) else photo.photo
    empty = _empty(pixels, photo.alpha, photo.background)
    return empty if empty is None or photo.mask is None else empty & photo.mask


def background_shows(photo: Photo | View) -> NDArray[np.bool_] | None:
    """[H, W] px that show the background more than anything before it; None where the photo does not say.

    Their colour says nothing of the scene: white is no clipped highlight there.
    """
    if photo.alpha is None:
        return empty_pixels(photo)
    return np.asarray(photo.alpha < np.iinfo(photo.alpha.dtype).max / 2)


def around(pixels: Pixels, background: Background) -> NDArray[np.bool_]:
    """[H, W] px of an opaque photo [H, W, 3] that hang together with its border in the background's colour."""
    if background.tolerance is None:
        raise ValueError("The background has no tolerance: nothing says what is like it")
    top = int(np.iinfo(pixels.dtype).max)
    colour = np.asarray(background.colour) * top
    alike = np.ones(pixels.shape[:2], bool)
    for channel in range(3):
        plane = pixels[:, :, channel]
        alike &= (plane >= colour[channel] - background.tolerance * top) & (
            plane <= colour[channel] + background.tolerance * top
        )
    numbers, count = label(alike)
    at_border = np.zeros(count + 1, bool)
    for edge in (numbers[0], numbers[-1], numbers[:, 0], numbers[:, -1]):
        at_border[edge] = True
    at_border[0] = False
    return at_border[numbers]


def _empty(pixels: Pixels, alpha: Pixels | None, background: Background | None) -> NDArray[np.bool_] | None:
    if alpha is not None:
        return np.asarray(alpha == 0)
    if background is None or background.tolerance is None:
        return None
    return around(pixels, background)
