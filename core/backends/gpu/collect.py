"""What is added up of views, on the card: for density control, and of what photos see of each Gaussian."""

from __future__ import annotations

import struct

import numpy as np
import torch
from torch import Tensor

from ...camera import Camera
from ...gaussians import Gaussians
from ...rendering import RasterSettings
from .card import card
from .layout import GROUP
from .operands import belongs_on_card
from .rasterizer import view_numbers
from .tensors import CardTensor, for_shader, in_place, part_for_shader


def collected_on_card(centres: Tensor, radius: Tensor, gradients: Tensor, views: Tensor) -> bool:
    """See `core.devices.Backend.collect`; False where the values are not the card's, and nothing was done."""
    if not isinstance(centres, CardTensor) or centres.dtype != torch.float32 or not centres.numel():
        return False
    if not centres.is_contiguous() or not belongs_on_card(centres, gradients, views):
        return False
    numbers = struct.pack("2I", len(centres), centres.local.storage_offset())
    memories = centres.held.for_card(), for_shader(radius), in_place(gradients), in_place(views)
    card().for_each("collect", len(centres), GROUP, numbers, *memories)
    return True


def seen_on_card(
    sums: tuple[Tensor, Tensor, Tensor],
    gradient: Tensor,
    gaussians: Gaussians,
    camera: Camera,
    settings: RasterSettings,
) -> None:
    """See `core.devices.Backend.add_seen`."""
    shape = len(gaussians), int(gaussians.sh.shape[1])
    view = view_numbers(camera, None, settings, np.zeros(3, np.float32), shape, learns=False)
    memory, first = part_for_shader(gradient)
    shapes = [
        for_shader(t) for t in (gaussians.means, gaussians.log_scales, gaussians.quaternions, gaussians.opacity_logits)
    ]
    numbers = view + struct.pack("I", first)
    card().for_each("seen", len(gaussians), GROUP, numbers, *shapes, memory, *(in_place(one) for one in sums))
