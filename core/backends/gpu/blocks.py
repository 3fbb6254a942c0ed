"""What shaders that go over images block by block are given: groups, and which values count."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .card import Memory
from .layout import BLOCK_HIGH, BLOCK_WIDE
from .operands import unused
from .tensors import CardTensor, bytes_for_shader


def blocks(width: int, height: int, planes: int = 1) -> tuple[int, int]:
    """Groups across and down for planes of an image, whose blocks stand below each other."""
    return -(-width // BLOCK_WIDE), planes * -(-height // BLOCK_HIGH)


def is_whole(tensor: Tensor) -> bool:
    """Whether a shader may change a float32 tensor in place."""
    mine = isinstance(tensor, CardTensor) and tensor.dtype == torch.float32
    return mine and tensor.is_contiguous() and not tensor.storage_offset()


@dataclass(frozen=True)
class Mask:
    """Which values of a photo count.

    Attributes:
        memory: a byte for each, of one plane or of all.
        numbers: 1 if there is a mask at all, and how many values lie between two planes' (0: all share one).
    """

    memory: Memory
    numbers: tuple[int, int]

    @staticmethod
    def of(valid: Tensor | None) -> Mask:
        """[H, W] or [3, H, W] bool, or None."""
        if valid is None:
            return Mask(unused(), (0, 0))
        shared = valid.ndim == 2 or len(valid) == 1
        return Mask(bytes_for_shader(valid), (1, 0 if shared else valid.shape[-2] * valid.shape[-1]))
