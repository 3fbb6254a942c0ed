"""How far a photo is from a render, and how much a render varies, on the card; specified in `core.training`."""

from __future__ import annotations

import struct

import numpy as np
from torch import Tensor

from ...training.variation import SMOOTH
from .card import card
from .layout import GROUP
from .tensors import empty, for_shader, written


def photometric_on_card(image: Tensor, photo: Tensor, ssim_weight: float) -> tuple[float, Tensor]:
    """Value and gradient [3, H, W] of MAE + SSIM; every value of the photo counts, and is finite."""
    device, count = card(), image.numel()
    gradient, groups = empty(*image.shape), -(-count // GROUP)
    weights = (1 - ssim_weight) / count, ssim_weight / count
    numbers = struct.pack("3I2f", image.shape[2], image.shape[1], count, *weights)
    shown, taken = for_shader(image), for_shader(photo)
    fields, derivatives, windows = (device.memory(4 * n * count) for n in (5, 3, 3))
    sums, total = device.memory(8 * groups), device.memory(8)
    device.for_each("ssim_down", count, GROUP, numbers, shown, taken, fields)
    device.for_each("ssim_across", count, GROUP, numbers, shown, taken, fields, derivatives, sums)
    device.for_each("ssim_back_down", count, GROUP, numbers, derivatives, windows)
    into = gradient.held.for_card(overwrite=True)
    device.for_each("ssim_back_across", count, GROUP, numbers, shown, taken, windows, into)
    device.run("total", (1, 1), struct.pack("I", groups), sums, total)
    structure, error = (float(n) / count for n in device.read(total, 8).view(np.float32))
    return (1 - ssim_weight) * error + ssim_weight * (1 - structure), written(gradient)


def variation_on_card(image: Tensor, knee: float) -> Tensor:
    """See `core.training.variation.variation_gradient`."""
    _, height, width = image.shape
    gradient = empty(*image.shape)
    numbers = struct.pack("2I2f", width, height, SMOOTH**2, 1.0 / knee)
    into = gradient.held.for_card(overwrite=True)
    card().for_each("variation", width * height, GROUP, numbers, for_shader(image), into)
    return written(gradient)
