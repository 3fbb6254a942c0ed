"""A photo with another exposure, on the card; specified in `core.training.optics.exposures`."""

from __future__ import annotations

import struct

from torch import Tensor

from ...devices import LevelCurve
from .card import card
from .layout import GROUP
from .tensors import CardTensor, empty, for_shader, written


def reexposed_on_card(photo: Tensor, shown: Tensor, curve: LevelCurve) -> CardTensor:
    """See `core.devices.Backend.reexposed`."""
    planes, height, width = photo.shape
    made = empty(planes, height, width)
    whole = struct.pack("4I", made.numel(), height * width, curve.table.shape[1], 0)
    limits = (struct.pack("3I4x", *(int(n) for n in levels)) for levels in (curve.white, curve.black))
    most = struct.pack("3f4x", *curve.most.tolist())
    memories = for_shader(photo), for_shader(shown), for_shader(curve.table), made.held.for_card(overwrite=True)
    card().for_each("reexposed", made.numel(), GROUP, b"".join((whole, *limits, most)), *memories)
    return written(made)
