"""Adam's steps on the card: parameters, moments and counts of what was refused stay there for a whole training."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from ...devices import AdamStep
from .card import card
from .layout import GROUP
from .tensors import in_place, part_for_shader


def adam_steps(steps: Sequence[AdamStep]) -> None:
    """Makes the steps."""
    device = card()
    for step in steps:
        count = step.values.numel()
        period = max(1, count // max(1, step.values.shape[0]))
        shares = (1 - decay for decay in step.betas)
        gradient, begins = part_for_shader(step.gradient)
        numbers = struct.pack("4I", count, period, step.leading or period, begins) + struct.pack(
            "8f", step.rate, step.tail, *step.betas, *shares, step.correction, step.epsilon
        )
        changed = [in_place(tensor) for tensor in (step.values, step.first, step.second, step.refused)]
        device.for_each("adam", count, GROUP, numbers, gradient, *changed)
