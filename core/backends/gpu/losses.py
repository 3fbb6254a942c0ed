"""How far a photo is from a render, and how much a render varies, on the card; specified in `core.training`."""

from __future__ import annotations

import struct
from math import prod

import numpy as np
from torch import Tensor

from ...training.variation import SMOOTH
from .card import card
from .layout import BLOCK_HIGH, BLOCK_WIDE, GROUP
from .operands import unused
from .tensors import bytes_for_shader, empty, for_shader, written


def photometric_on_card(image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float) -> tuple[float, Tensor]:
    """Value and gradient [3, H, W] of MAE + SSIM; see `core.training.photometric`.

    Args:
        valid: [H, W] or [3, H, W] bool, which values of the photo count; None for all. Those not finite never do.
    """
    planes, height, width = image.shape
    device, count, gradient = card(), image.numel(), empty(*image.shape)
    blocks_down = -(-height // BLOCK_HIGH)
    groups = -(-width // BLOCK_WIDE), planes * blocks_down
    mask, plane = unused(), 0
    if valid is not None:
        mask, plane = bytes_for_shader(valid), 0 if valid.numel() < count else height * width
    table = width, height, count, blocks_down, int(valid is not None), plane
    numbers = struct.pack("6I2f", *table, 1 - ssim_weight, ssim_weight)
    shown = for_shader(image), for_shader(photo), mask
    derivatives, sums, totals = (device.memory(size) for size in (12 * count, 16 * prod(groups), 16))
    device.run("ssim", groups, numbers, *shown, derivatives, sums)
    device.run("total", (1, 1), struct.pack("I", prod(groups)), sums, totals)
    device.run("ssim_back", groups, numbers, *shown, derivatives, totals, gradient.held.for_card(overwrite=True))
    counted, structure, error, _ = (float(n) for n in device.read(totals, 16).view(np.float32))
    if not counted:
        return 0.0, written(gradient)
    value = (1 - ssim_weight) * error / counted + ssim_weight * (1 - structure / counted)
    return value, written(gradient)


def variation_on_card(image: Tensor, knee: float) -> Tensor:
    """See `core.training.variation.variation_gradient`."""
    _, height, width = image.shape
    gradient = empty(*image.shape)
    numbers = struct.pack("2I2f", width, height, SMOOTH**2, 1.0 / knee)
    into = gradient.held.for_card(overwrite=True)
    card().for_each("variation", width * height, GROUP, numbers, for_shader(image), into)
    return written(gradient)


def specks_on_card(image: Tensor) -> Tensor:
    """See `core.training.specks.speck_gradient`."""
    _, height, width = image.shape
    device, count = card(), height * width
    gradient, numbers = empty(*image.shape), struct.pack("2I", width, height)
    shown = for_shader(image)
    tensor, slants, means = (device.memory(12 * count) for _ in range(3))
    device.for_each("speck_tensor", count, GROUP, numbers, shown, tensor)
    device.for_each("speck_slants", count, GROUP, numbers, tensor, slants)
    device.for_each("speck_means", count, GROUP, numbers, slants, means)
    into = gradient.held.for_card(overwrite=True)
    device.for_each("speck_gradient", count, GROUP, numbers, shown, means, into)
    return written(gradient)
