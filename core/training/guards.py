"""Nothing non-finite survives, and nothing is repaired in silence."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ..constants import LOG_SCALE_LIMIT
from ..errors import NonFiniteParameter
from ..gaussians import Gaussians
from ..numbers import number
from .optimizer import Adam


@dataclass(frozen=True)
class GuardSettings:
    """Numbers of the guards."""

    every: int = number(50, "steps", "between two checks of all parameters; a check costs half a millisecond")


GUARDS = GuardSettings()


def non_finite_rows(gaussians: Gaussians) -> dict[str, torch.Tensor]:
    """[N] bool by parameter name, for the parameters that have a non-finite value at all."""
    found = {}
    for name, tensor in gaussians.named():
        if not bool(torch.isfinite(tensor.detach().sum())):
            bad = ~torch.isfinite(tensor.detach().reshape(len(tensor), -1)).all(dim=1)
            if bool(bad.any()):
                found[name] = bad
    return found


def out_of_range(gaussians: Gaussians) -> int:
    """How many Gaussians have a scale that the projection clamps (`LOG_SCALE_LIMIT`)."""
    largest = gaussians.log_scales.detach().abs().max() if len(gaussians) else 0.0
    if not largest >= LOG_SCALE_LIMIT:
        return 0
    return int((gaussians.log_scales.detach().abs() >= LOG_SCALE_LIMIT).any(dim=1).sum())


def drop_non_finite(optimizer: Adam, step: int) -> dict[str, int]:
    """Removes Gaussians with a non-finite parameter; returns how many, by parameter name.

    Raises:
        NonFiniteParameter: every Gaussian is lost.
    """
    found = non_finite_rows(optimizer.gaussians)
    if not found:
        return {}
    bad = torch.stack(list(found.values())).any(dim=0)
    if bool(bad.all()):
        names = ", ".join(found)
        raise NonFiniteParameter(
            f"All Gaussians became non-finite at step {step}, first in {names}",
            "Lower the step sizes, or check the cameras and the photos",
        )
    g = optimizer.gaussians.detached()
    optimizer.keep_and_append(torch.nonzero(~bad)[:, 0], Gaussians(**{name: tensor[:0] for name, tensor in g.named()}))
    return {name: int(rows.sum()) for name, rows in found.items()}
