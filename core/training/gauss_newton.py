"""What a photo says of a few numbers that it depends on: a robust step of Gauss and Newton."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..colour import linear_to_srgb
from ..forward import Exposed
from ..imaging.formation.effect import Effect

Array = NDArray[np.float64]


class Robustness(Protocol):
    """What is asked of settings: see `training.focus.LearnedFocusSettings`."""

    @property
    def huber(self) -> float: ...

    @property
    def looked_at(self) -> int: ...

    @property
    def independent(self) -> float: ...


def normal_equations(
    photo: Tensor, still: Tensor, slopes: Sequence[tuple[Tensor, float]], counts: Tensor | None, settings: Robustness
) -> tuple[Array, Array]:
    """Matrix [K, K] and vector [K] of the step that K numbers should take, the photo's noise as it shows.

    Args:
        photo: [3, H, W]; still: the same as predicted; slopes: K predictions after a change of each number, with that
            change; counts: [H, W] bool, None for all px.
    """
    every = max(1, round(math.sqrt(photo.shape[1] * photo.shape[2] / settings.looked_at)))
    at = (..., slice(every // 2, None, every), slice(every // 2, None, every))
    rest = (photo - still)[at].reshape(-1).double()
    jacobian = torch.stack([((moved - still)[at] / by).reshape(-1).double() for moved, by in slopes])
    weight = torch.ones_like(rest)
    if counts is not None:
        weight = counts[at].expand(3, *counts[at].shape).reshape(-1).to(rest)
    limit = max(settings.huber * 1.4826 * float(rest.abs().median()), 1e-3)
    weight = weight * (limit / rest.abs().clamp(min=1e-12)).clamp(max=1.0)
    noise = float((weight * rest.square()).sum() / weight.sum().clamp(min=1.0))
    trust = settings.independent / max(float(weight.numel()), 1.0) / max(noise, 1e-8)
    weighted = jacobian * weight
    return (weighted @ jacobian.T * trust).cpu().numpy(), (weighted @ rest * trust).cpu().numpy()


def shown_with(exposed: Exposed, effect: Effect, other: Effect) -> Tensor:
    """[3, H, W] sRGB: the photo with another effect in the place of one before the blur."""
    total: Tensor | None = None
    for passage, weight in exposed.passages:
        place = next(i for i, one in enumerate(passage.effects) if one is effect)
        light = other.forward(passage.stages[place], passage.shot)
        for behind in passage.effects[place + 1 :]:
            light = behind.forward(light, passage.shot)
        total = light * weight if total is None else total + light * weight
    assert total is not None
    return exposed.medium.degraded(linear_to_srgb(total))
