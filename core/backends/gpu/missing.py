"""What is missing in a render, from a photo's residual to the gradient, on the card; specified in `core.devices` and
`core.backends.reference`."""

from __future__ import annotations

import struct

import torch
from torch import Tensor

from ...devices import Missing
from .blocks import Mask, blocks, is_whole
from .card import card
from .layout import GROUP
from .operands import operand, unused
from .tensors import CardTensor, empty, for_shader, in_place, written


def residual_on_card(
    photo: Tensor, blurred: Tensor, valid: Tensor | None, margin: int, size: tuple[int, int]
) -> CardTensor:
    """See `core.devices.Backend.residual`."""
    planes, height, width = photo.shape
    made, mask = empty(planes, *size), Mask.of(valid)
    numbers = struct.pack("7I", width, height, margin, size[1], size[0], *mask.numbers)
    memories = for_shader(photo), for_shader(blurred), mask.memory, made.held.for_card(overwrite=True)
    card().run("residual", blocks(size[1], size[0], planes), numbers, *memories)
    return written(made)


def filtered_on_card(spectrum: Tensor, own: Tensor, shared: Tensor) -> bool:
    """See `core.devices.Backend.filter_colours`; False where the tensors are not the card's."""
    kinds = torch.float32, torch.complex64
    for tensor in (spectrum, own, shared):
        if not isinstance(tensor, CardTensor) or tensor.dtype not in kinds or not _is_plain(tensor):
            return False
    assert isinstance(spectrum, CardTensor) and isinstance(own, CardTensor) and isinstance(shared, CardTensor)
    if spectrum.dtype != torch.complex64 or len(spectrum) != 3 or {own.shape, shared.shape} != {spectrum.shape[1:]}:
        return False
    numbers = struct.pack("3I", own.numel(), int(own.is_complex()), int(shared.is_complex()))
    memories = own.held.for_card(), shared.held.for_card(), spectrum.held.for_card()
    card().for_each("filter_colours", own.numel(), GROUP, numbers, *memories)
    written(spectrum)
    return True


def _is_plain(tensor: CardTensor) -> bool:
    """Whether its values stand one behind the other, from the beginning, as they are."""
    return tensor.is_contiguous() and not tensor.storage_offset() and not tensor.local.is_conj()


def drawn_on_card(gradient: Tensor, missing: Missing) -> bool:
    """See `core.devices.Backend.draw`; False where the card cannot change the gradient in place."""
    seen, m = operand(missing.values), missing.margin
    if not is_whole(gradient) or seen.steps[-1] != 1 or missing.values.dtype != torch.float32:
        return False
    planes, height, width = gradient.shape[0], gradient.shape[1] - 2 * m, gradient.shape[2] - 2 * m
    mask, image, light, least = Mask.of(missing.valid), unused(), unused(), 0.0
    if missing.curve is not None:
        image, light, least = for_shader(missing.curve[0]), for_shader(missing.curve[1]), missing.curve[2]
    linear = int(missing.curve is not None)
    table = width, height, m, seen.steps[1], seen.steps[0], seen.offset, *mask.numbers, linear
    numbers = struct.pack("9I3f", *table, least, missing.width**2, missing.weight)
    memories = seen.held.for_card(), mask.memory, image, light, in_place(gradient)
    card().run("draw", blocks(width, height, planes), numbers, *memories)
    return True
