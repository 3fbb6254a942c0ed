"""What a photo says of a few numbers that it depends on: a robust step of Gauss and Newton."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...colour import linear_to_srgb
from ...devices import all_in_memory
from ...forward import Exposed
from ...forward.medium import FixedMedium
from ...imaging.formation.by_depth import DepthBlur

Array = NDArray[np.float64]


class Robustness(Protocol):
    """What is asked of settings: see `training.optics.focus.LearnedFocusSettings`."""

    @property
    def huber(self) -> float: ...

    @property
    def looked_at(self) -> int: ...

    @property
    def independent(self) -> float: ...


@dataclass(frozen=True)
class LookedAt:
    """Which px of a photo a step looks at: rows and columns, evenly over it."""

    rows: range
    columns: slice

    @staticmethod
    def of(height: int, width: int, settings: Robustness) -> LookedAt:
        """About as many as the settings say."""
        every = max(1, round(math.sqrt(height * width / settings.looked_at)))
        return LookedAt(range(every // 2, height, every), slice(every // 2, None, every))

    def of_planes(self, planes: Tensor) -> Tensor:
        """[..., h, w] of planes [..., H, W]."""
        return planes[..., self.rows.start :: self.rows.step, self.columns]


def normal_equations(
    photo: Tensor, still: Tensor, slopes: Sequence[tuple[Tensor, float]], counts: Tensor | None, settings: Robustness
) -> tuple[Array, Array]:
    """Matrix [K, K] and vector [K] of the step that K numbers should take, the photo's noise as it shows.

    Args:
        photo: [3, H, W]; still: the same as predicted; slopes: K predictions [3, h, w] after a change of each number,
            with that change, at the px looked at (`shown_with`); counts: [H, W] bool, None for all px.
    """
    at = LookedAt.of(photo.shape[1], photo.shape[2], settings)
    unmoved, shown, *moved = all_in_memory(at.of_planes(still), at.of_planes(photo), *(one for one, _ in slopes))
    rest = (shown - unmoved).reshape(-1).double()
    changes = zip(moved, (by for _, by in slopes), strict=True)
    jacobian = torch.stack([((one - unmoved) / by).reshape(-1).double() for one, by in changes])
    weight = torch.ones_like(rest)
    if counts is not None:
        counted = at.of_planes(counts)
        weight = counted.expand(3, *counted.shape).reshape(-1).to(rest)
    limit = max(settings.huber * 1.4826 * float(rest.abs().median()), 1e-3)
    weight = weight * (limit / rest.abs().clamp(min=1e-12)).clamp(max=1.0)
    noise = float((weight * rest.square()).sum() / weight.sum().clamp(min=1.0))
    trust = settings.independent / max(float(weight.numel()), 1.0) / max(noise, 1e-8)
    weighted = jacobian * weight
    return (weighted @ jacobian.T * trust).cpu().numpy(), (weighted @ rest * trust).cpu().numpy()


def shown_with(exposed: Exposed, effect: DepthBlur, other: DepthBlur, at: LookedAt) -> Tensor:
    """[3, h, w] sRGB at the px looked at: the photo with another effect in the place of one before the blur.

    Where nothing behind the effect mixes px, only the rows that are looked at are computed.
    """
    last = all(passage.effects[-1] is effect for passage, _ in exposed.passages)
    if last and isinstance(exposed.medium, FixedMedium) and exposed.medium.blur.evaluation == "identity":
        return _rows_with(exposed, exposed.medium, other, at)
    total: Tensor | None = None
    for passage, weight in exposed.passages:
        place = next(i for i, one in enumerate(passage.effects) if one is effect)
        light = other.forward(passage.stages[place], passage.shot)
        for behind in passage.effects[place + 1 :]:
            light = behind.forward(light, passage.shot)
        total = light * weight if total is None else total + light * weight
    assert total is not None
    return at.of_planes(exposed.medium.degraded(linear_to_srgb(total)))


def _rows_with(exposed: Exposed, medium: FixedMedium, other: DepthBlur, at: LookedAt) -> Tensor:
    """The same where the effect is the last that mixes px."""
    margin = exposed.shot.margin
    rows = range(at.rows.start + margin, at.rows.stop + margin, at.rows.step)
    total: Tensor | None = None
    for passage, weight in exposed.passages:
        inside = slice(margin, passage.shot.width + margin)
        light = other.rows(passage.stages[-2], passage.shot, rows)[..., inside][..., at.columns] * weight
        total = light if total is None else total + light
    assert total is not None
    return medium.encoded(medium.decoded(linear_to_srgb(total.contiguous())))
