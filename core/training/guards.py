"""Nothing non-finite survives, and nothing is repaired in silence."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ..constants import LOG_SCALE_LIMIT
from ..devices import Guarded
from ..errors import NonFiniteParameter
from ..gaussians import Gaussians
from ..numbers import number
from .optimizer import Adam


@dataclass(frozen=True)
class GuardSettings:
    """Numbers of the guards."""

    every: int = number(50, "steps", "between two checks of all parameters; a check costs half a millisecond")
    largest: float = number(
        0.2,
        "of the distance to the nearest camera",
        "a Gaussian's largest standard deviation: a larger one is no longer what its projection takes it for, and one"
        " behind a wall, fed by the light of its cracks, stands as fog before the whole frame of a view from elsewhere",
        "the room from inside, fine and best: without 27.8 and 27.3 dB (worst view 23.7, 21.2: fog), with 28.4 and 28.5"
        " (26.6, 27.0); no other value was tried",
        "village, balanced and best: 32.3 (three seeds without 32.2 to 32.6) and 33.6 dB (33.4)",
    )


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


def limit_sizes(gaussians: Gaussians, centres: torch.Tensor) -> int:
    """Makes what is too large for its distance from the nearest camera as large as it may be; returns how many.

    Args:
        gaussians: changed in place. centres: [K, 3] of the cameras, in the same world.
    """
    with torch.no_grad():
        nearest = torch.full_like(gaussians.means[:, 0], torch.inf)
        for centre in centres:  # (all at once would be K times the memory)
            nearest = torch.minimum(nearest, (gaussians.means - centre).norm(dim=1))
        most = torch.log(GUARDS.largest * nearest)
        found = int((gaussians.log_scales.amax(dim=1) > most).sum())
        if found:
            gaussians.log_scales.copy_(torch.minimum(gaussians.log_scales, most[:, None]))
    return found


def guarded_in_torch(gaussians: Gaussians, centres: torch.Tensor) -> Guarded:
    """See `core.devices.Backend.guard`: what every back end does, in plain torch."""
    limited = limit_sizes(gaussians, centres)
    return Guarded(limited, out_of_range(gaussians), bool(non_finite_rows(gaussians)))


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
