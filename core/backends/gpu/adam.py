"""Adam's steps on the card: parameters and moments stay there for a whole training."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from ...devices import AdamStep
from .card import card
from .layout import GROUP
from .tensors import for_shader, in_place


def adam_steps(steps: Sequence[AdamStep]) -> list[int]:
    """Makes the steps; for each how many gradients were not finite, and moved nothing."""
    device = card()
    counters = [device.memory(4) for _ in steps]
    for step, refused in zip(steps, counters, strict=True):
        count = step.values.numel()
        period = max(1, count // max(1, step.values.shape[0]))
        device.clear(refused)
        changed = [in_place(tensor) for tensor in (step.values, step.first, step.second)]
        numbers = (
            struct.pack("3I", count, period, step.leading or period)
            + np.array(
                [
                    step.rate,
                    step.tail,
                    *step.betas,
                    *(1 - decay for decay in step.betas),
                    step.correction,
                    step.epsilon,
                ],
                np.float32,
            ).tobytes()
        )
        device.for_each("adam", count, GROUP, numbers, for_shader(step.gradient), *changed, refused)
    together = device.memory(4 * len(steps))
    for place, refused in enumerate(counters):
        device.copy(refused, together, 4, 0, 4 * place)
    return [int(n) for n in device.read(together, 4 * len(steps)).view(np.uint32)]
