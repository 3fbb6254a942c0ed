"""How far a photo is from a render, and how much a render varies, on the card; specified in `core.training`."""

from __future__ import annotations

import struct
from math import prod

import numpy as np
from torch import Tensor

from ...training.loss.variation import SMOOTH
from .blocks import Mask, blocks, is_whole
from .card import Memory, card
from .tensors import empty, for_shader, in_place, written


class LossOnCard:
    """A loss that is read when somebody wants to know it: a step need not wait for the card to end it."""

    def __init__(self, totals: Memory, ssim_weight: float) -> None:
        self._totals, self._ssim_weight = totals, ssim_weight

    def __float__(self) -> float:
        counted, structure, error, _ = (float(n) for n in card().read(self._totals, 16).view(np.float32))
        if not counted:
            return 0.0
        return (1 - self._ssim_weight) * error / counted + self._ssim_weight * (1 - structure / counted)


def photometric_on_card(
    image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float
) -> tuple[LossOnCard, Tensor]:
    """Value and gradient [3, H, W] of MAE + SSIM; see `core.training.loss.photometric`.

    Args:
        valid: [H, W] or [3, H, W] bool, which values of the photo count; None for all. Those not finite never do.
    """
    planes, height, width = image.shape
    device, count, gradient = card(), image.numel(), empty(*image.shape)
    groups, mask = blocks(width, height, planes), Mask.of(valid)
    table = width, height, count, groups[1] // planes, *mask.numbers
    numbers = struct.pack("6I2f", *table, 1 - ssim_weight, ssim_weight)
    shown = for_shader(image), for_shader(photo), mask.memory
    derivatives, sums, totals = (device.memory(size) for size in (12 * count, 16 * prod(groups), 16))
    device.run("ssim", groups, numbers, *shown, derivatives, sums)
    device.run("total", (1, 1), struct.pack("I", prod(groups)), sums, totals)
    device.run("ssim_back", groups, numbers, *shown, derivatives, totals, gradient.held.for_card(overwrite=True))
    return LossOnCard(totals, ssim_weight), written(gradient)


def variation_on_card(image: Tensor, knee: float, weight: float = 1.0, into: Tensor | None = None) -> Tensor:
    """See `core.devices.Backend.add_variation`."""
    return _gradient_added("variation", image, into, struct.pack("3f", SMOOTH**2, 1.0 / knee, weight))


def specks_on_card(image: Tensor, weight: float = 1.0, into: Tensor | None = None) -> Tensor:
    """See `core.devices.Backend.add_specks`."""
    return _gradient_added("specks", image, into, struct.pack("f", weight))


def _gradient_added(kernel: str, image: Tensor, into: Tensor | None, numbers: bytes) -> Tensor:
    """A gradient by the values of an image [3, H, W], added to `into` in place."""
    _, height, width = image.shape
    shown, groups = for_shader(image), blocks(width, height)
    if into is not None and is_whole(into):
        card().run(kernel, groups, struct.pack("3I", width, height, 1) + numbers, shown, in_place(into))
        return into
    made = empty(*image.shape)
    target = made.held.for_card(overwrite=True)
    card().run(kernel, groups, struct.pack("3I", width, height, 0) + numbers, shown, target)
    return written(made) if into is None else into.add_(written(made))
