"""The check of all parameters on the card; specified in `core.training.guards`."""

from __future__ import annotations

import struct

import numpy as np
from torch import Tensor

from ...devices import Guarded
from ...gaussians import Gaussians
from ...training.guards import GUARDS
from .card import card
from .layout import GROUP
from .tensors import for_shader, in_place


def guarded_on_card(gaussians: Gaussians, centres: Tensor) -> Guarded:
    """See `core.devices.Backend.guard`; sizes of Gaussians that are not finite are left as they are."""
    device, count = card(), len(gaussians)
    numbers = struct.pack("3If", count, gaussians.sh.shape[1], len(centres), GUARDS.largest)
    g, found = gaussians, device.memory(12)
    device.clear(found)
    memories = for_shader(g.means), in_place(g.log_scales), *map(for_shader, (g.quaternions, g.opacity_logits, g.sh))
    device.for_each("guard", count, GROUP, numbers, *memories, for_shader(centres), found)
    limited, clamped, broken = (int(n) for n in device.read(found, 12).view(np.uint32))
    return Guarded(limited, clamped, broken > 0)
