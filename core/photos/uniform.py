"""Whether all photos of a set show the same plain colour around their object, and which px of them are empty.

A studio's white, a render over white or black: the border of every photo has one colour, the same in all of them. A
table, a wall or the sky has not: light falls off, structure shows, exposures differ. Blocks of the border are averaged,
so that noise hardly counts and a drift of two steps of 8 bits does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..background import Background, BackgroundRequest
from ..numbers import number
from ..progress import Progress
from .empty import around
from .load import Photo

Array = NDArray[np.float64]
_CHOSEN = "before a set was looked at"
_CHECKED = (
    "copr, banana, brighton, tea, drinks: at most 0.29 of any photo's border is plain; lego over white, black and "
    "grey: at least 0.99"
)


@dataclass(frozen=True)
class UniformSettings:
    """Numbers of the search for a plain background."""

    block: int = number(8, "px", "side of the border's blocks that are averaged: noise falls to an eighth")
    step: float = number(
        2.0 / 255.0, "sRGB", "by which blocks of one plain colour may differ besides noise: what JPEG leaves of it"
    )
    deviations: float = number(4.0, "standard deviations of the noise", "beyond which a block is another colour")
    border_share: float = number(
        0.9, "share", "of a photo's border that must be plain: an object may be cut by it", _CHOSEN, _CHECKED
    )
    photo_share: float = number(0.9, "share", "of the photos that must have the same plain border", _CHOSEN, _CHECKED)
    fewest_photos: int = number(3, "count", "photos that can prove a background: two may show the same wall")
    px_share: float = number(0.999, "share", "of the border's px that count as the background's: the others are noise")
    most_noise: float = number(
        0.1, "sRGB", "standard deviation; with more, object and background cannot be distinguished"
    )
    frame_share: float = number(
        0.97, "share", "of its bounding box that what is left may fill: more is a picture in a frame, not an object"
    )


SETTINGS = UniformSettings()


@dataclass(frozen=True)
class _Border:
    """A photo's border: colours of its blocks [n, 3], and the standard deviation of the noise in them, sRGB."""

    blocks: Array
    noise: float


def uniform_background(photos: Sequence[Photo]) -> Background | None:
    """The plain colour that (nearly) all photos show around what they show; None where they do not.

    Photos with alpha say themselves where they are empty: None.
    """
    if len(photos) < SETTINGS.fewest_photos or any(photo.alpha is not None for photo in photos):
        return None
    borders = _borders(photos)
    if len(borders) < SETTINGS.photo_share * len(photos):
        return None
    noise = _noise(borders)
    if noise > SETTINGS.most_noise:
        return None
    colour = np.median([np.median(border.blocks, axis=0) for border in borders], axis=0)
    if sum(_is_plain(border, colour, noise) for border in borders) < SETTINGS.photo_share * len(photos):
        return None
    red, green, blue = (round(float(value), 5) for value in colour)
    found = Background((red, green, blue), tolerance=_tolerance(photos, colour, noise))
    return None if _is_frame(photos, found) else found


def before_background(photos: list[Photo], asked: BackgroundRequest, progress: Progress) -> list[Photo]:
    """The photos of a set as `load_photos` gives them, with what is known to be behind them."""
    if not photos or any(photo.alpha is not None for photo in photos):
        return photos
    if asked.colour is not None:
        noise = _noise(_borders(photos))
        found: Background | None = Background(
            asked.colour, tolerance=_tolerance(photos, np.asarray(asked.colour), noise)
        )
    else:
        found = uniform_background(photos) if asked.looked_for else None
    if found is None:
        return photos
    if asked.colour is None:
        progress.note(f"All photos show the same plain {found.name} behind the object; it is taken for empty space")
    return [replace(photo, background=found) for photo in photos]


def like_the_others(photos: list[Photo], others: Sequence[Photo]) -> list[Photo]:
    """New photos for a set: those that show its plain background have it behind them, too."""
    known = next((photo.background for photo in others if photo.background is not None), None)
    if known is None or known.tolerance is None or any(photo.alpha is not None for photo in photos):
        return photos
    colour, borders = np.asarray(known.colour), [_border(photo) for photo in photos]
    plain = [border is not None and _is_plain(border, colour, border.noise) for border in borders]
    return [replace(photo, background=known) if same else photo for photo, same in zip(photos, plain, strict=True)]


def _borders(photos: Sequence[Photo]) -> list[_Border]:
    return [border for photo in photos if (border := _border(photo)) is not None]


def _noise(borders: Sequence[_Border]) -> float:
    return float(np.median([border.noise for border in borders])) if borders else 0.0


def _tolerance(photos: Sequence[Photo], colour: Array, noise: float) -> float:
    """How far single px of the plain blocks lie from the colour: what JPEG leaves of noise has no simple deviation."""
    apart = [np.zeros(1)]
    for photo in photos:
        pixels = _border_px(photo)
        if pixels is not None:
            plain = pixels[_like(pixels.mean(axis=(1, 2)), colour, noise)]
            apart.append(np.abs(plain - colour).max(axis=3).ravel())
    return max(SETTINGS.step, float(np.quantile(np.concatenate(apart), SETTINGS.px_share)))


def _is_plain(border: _Border, colour: Array, noise: float) -> bool:
    return bool(_like(border.blocks, colour, noise).mean() >= SETTINGS.border_share)


def _like(blocks: Array, colour: Array, noise: float) -> NDArray[np.bool_]:
    """[n] which blocks [n, 3] have a colour."""
    within = SETTINGS.step + SETTINGS.deviations * noise / SETTINGS.block
    return np.asarray((np.abs(blocks - colour) <= within).all(axis=1))


def _border(photo: Photo) -> _Border | None:
    pixels = _border_px(photo)
    if pixels is None:
        return None
    # Differences of neighbours: what drifts through a block is no noise.
    noise = 1.4826 * float(np.median(np.abs(np.diff(pixels, axis=2)))) / 2**0.5
    return _Border(pixels.mean(axis=(1, 2)), noise)


def _border_px(photo: Photo) -> Array | None:
    """[n, b, b, 3] blocks along the border all of whose px count; None where there are none."""
    b, (width, height) = SETTINGS.block, photo.size
    if min(width, height) < 4 * b:
        return None
    unit = 1.0 / np.iinfo(photo.pixels.dtype).max
    strips = [
        photo.pixels[:b],
        photo.pixels[-b:],
        photo.pixels[:, :b].swapaxes(0, 1),
        photo.pixels[:, -b:].swapaxes(0, 1),
    ]
    blocks = [_blocks(strip * unit) for strip in strips]
    together = np.concatenate(blocks)  # [n, b, b, 3]
    if photo.mask is not None:
        parts = [photo.mask[:b], photo.mask[-b:], photo.mask[:, :b].T, photo.mask[:, -b:].T]
        counted = np.concatenate([_blocks(part[:, :, None]) for part in parts]).all(axis=(1, 2, 3))
        together = together[counted]
    return together if len(together) else None


def _blocks(strip: NDArray[Any]) -> NDArray[Any]:
    """[b, L, C] -> [L // b, b, b, C]"""
    b = SETTINGS.block
    count = strip.shape[1] // b
    return strip[:, : count * b].reshape(b, count, b, -1).swapaxes(0, 1)


def _is_frame(photos: Sequence[Photo], background: Background) -> bool:
    """Whether what is not background is a rectangle in every photo: a letterbox, or a lens undone elsewhere."""
    for photo in photos:
        full = ~around(photo.pixels, background)
        rows, columns = np.flatnonzero(full.any(axis=1)), np.flatnonzero(full.any(axis=0))
        if len(rows) and full[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].mean() < SETTINGS.frame_share:
            return False
    return True
