"""How far a photo is from a render, and how much a render varies, on the card; specified in `core.training`."""

from __future__ import annotations

import struct

import numpy as np
from torch import Tensor

from ...training.variation import SMOOTH
from .card import card
from .layout import GROUP
from .operands import unused
from .tensors import bytes_for_shader, empty, for_shader, written


def photometric_on_card(image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float) -> tuple[float, Tensor]:
    """Value and gradient [3, H, W] of MAE + SSIM; see `core.training.photometric`.

    Args:
        valid: [H, W] or [3, H, W] bool, which values of the photo count; None for all. Those not finite never do.
    """
    device, count = card(), image.numel()
    gradient, groups = empty(*image.shape), -(-count // GROUP)
    masked = 0 if valid is None else valid.numel()
    numbers = struct.pack("4I2f", image.shape[2], image.shape[1], count, masked, 1 - ssim_weight, ssim_weight)
    mask = unused() if valid is None else bytes_for_shader(valid)
    filled, weights, fields, derivatives, windows = (device.memory(4 * n * count) for n in (2, 1, 5, 3, 3))
    sums, totals = device.memory(8 * groups), device.memory(16)
    memories = for_shader(image), for_shader(photo), mask
    device.for_each("ssim_fill", count, GROUP, numbers, *memories, filled, weights, sums)
    device.run("total", (1, 1), struct.pack("2I", groups, 0), sums, totals)
    device.for_each("ssim_down", count, GROUP, numbers, filled, fields)
    device.for_each("ssim_across", count, GROUP, numbers, filled, weights, fields, derivatives, sums)
    device.run("total", (1, 1), struct.pack("2I", groups, 1), sums, totals)
    device.for_each("ssim_back_down", count, GROUP, numbers, derivatives, windows)
    into = gradient.held.for_card(overwrite=True)
    device.for_each("ssim_back_across", count, GROUP, numbers, filled, weights, windows, totals, into)
    counted, _, structure, error = (float(n) for n in device.read(totals, 16).view(np.float32))
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
