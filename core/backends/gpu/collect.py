"""What density control adds up of every view, on the card."""

from __future__ import annotations

import struct

import torch
from torch import Tensor

from .card import card
from .layout import GROUP
from .operands import belongs_on_card
from .tensors import CardTensor, for_shader, in_place


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
