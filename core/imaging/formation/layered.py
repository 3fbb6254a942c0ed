"""A blur whose width differs from px to px: the light of every px spreads by its own Gaussian.

    H x = (sum_k K_k (w_k . x)) / (sum_k K_k w_k)

K_k are Gaussians on a fixed ladder of widths, and the weights w_k(px) mix the two next to the px's own width, linearly
in variance, so that the variance is exact. The denominator keeps a constant picture constant, and leaves no dark seam
where a blurred foreground ends.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from ...devices import Tent, backend_on
from ...numbers import BY_DEFINITION, number
from ..operator import BlurOperator
from ..psf import PointSpread, gaussian_taps


@dataclass(frozen=True)
class LayeredSettings:
    """Numbers of a blur whose width differs from px to px."""

    first: float = number(0.5, "px of the frame", "standard deviation of the ladder's lowest rung")
    ratio: float = number(
        1.6,
        "ratio",
        "of neighbouring rungs: half-way between two a mixture passes too much fine detail, at most 0.06 of the"
        " contrast with this ratio, 0.12 with a ratio of 2 (0.11 below the first rung)",
        BY_DEFINITION,
    )
    rungs: int = number(9, "count", "of the ladder, up to 21 px; more cost a blur each")
    invisible: float = number(
        0.3,
        "px of the frame",
        "a frame whose blur stays narrower everywhere is not touched: it dims the finest period that the px hold (2 px)"
        " by a third, periods of 4 px by a tenth",
        BY_DEFINITION,
    )
    widest: float = number(
        1 / 8, "share of the frame's shorter side", "beyond, a depth is wrong rather than the scene that blurred"
    )


LAYERED = LayeredSettings()
#: Standard deviations of the ladder, px of the frame.
LADDER = tuple(LAYERED.first * LAYERED.ratio**k for k in range(LAYERED.rungs))


class LadderBlur(ABC):
    """What every blur shares that mixes the rungs of a ladder, each px by its own place on it.

    Attributes:
        _place: [h, w] each px' place on the ladder, in what its tents are functions of.
    """

    _place: Tensor

    @abstractmethod
    def _rung(self, rung: int) -> BlurOperator:
        """The blur of a rung, from 1 on."""

    def _spread(self, rung: int, planes: Tensor) -> Tensor:
        if rung == 0:
            return planes
        return self._rung(rung)(planes) if planes.requires_grad else self._rung(rung).apply(planes)

    def _free_of_gradients(self, light: Tensor) -> bool:
        """Whether a back end's own passes do: they know neither autograd nor other types than float32."""
        return light.dtype == torch.float32 and not light.requires_grad and not self._place.requires_grad

    def _weighed(self, light: Tensor, tent: Tent) -> Tensor:
        """[C + 1, h, w] a level's share of the light, and its weights."""
        if self._free_of_gradients(light):
            return backend_on(light.device).layer_weighed(light, self._place, tent)
        return layer_weighed(light, self._place, tent)

    def _gathered(self, back: Tensor, light: Tensor, gradient: Tensor, in_place: Tensor, tent: Tent) -> None:
        """Adds a level's part to both gradients; back: [C + 1, h, w], what came back through its blur."""
        gather = backend_on(light.device).layer_gathered if self._free_of_gradients(light) else layer_gathered
        gather(back, light, self._place.detach(), tent, (gradient, in_place))


class LayeredBlur(LadderBlur):
    """The blur for one map of variances.

    Args:
        variance: [h, w] px^2 of the frame, >= 0; what is wider than the ladder's or frame's widest counts as that.
    """

    def __init__(self, variance: Tensor) -> None:
        variances = _variances(LAYERED.widest * min(variance.shape))
        lowest, highest = (float(v) for v in torch.aminmax(variance.detach()))
        self.identity = highest < LAYERED.invisible**2
        if self.identity:
            return
        first = max(i for i, v in enumerate(variances) if v <= lowest or i == 0)
        last = next((i for i, v in enumerate(variances) if v >= highest), len(variances) - 1)
        first = min(first, last - 1)
        self._place = variance.clamp(max=variances[-1])
        self._free = None if highest <= variances[-1] else variance.detach() <= variances[-1]
        self._levels = [(k, tent_of(variances[first : last + 1], k - first)) for k in range(first, last + 1)]
        self._norm: Tensor | None = None

    def apply(self, light: Tensor) -> Tensor:
        """[C, h, w] -> [C, h, w], differentiable in the light and in the variances."""
        if self.identity:
            return light
        total: Tensor | None = None
        for k, tent in self._levels:
            spread = self._spread(k, self._weighed(light, tent))
            total = spread if total is None else (total + spread if total.requires_grad else total.add_(spread))
        assert total is not None
        self._norm = total[-1:]
        return total[:-1] / self._norm

    def adjoint(self, upstream: Tensor, light: Tensor, out: Tensor) -> tuple[Tensor, Tensor | None]:
        """The transpose of `apply`, and the gradient in the variances [h, w] (None: they change nothing).

        Args:
            upstream: [C, h, w] gradient of a loss in `out`, which is `apply(light)`, called before.
        """
        if self.identity:
            return upstream, None
        assert self._norm is not None
        together = torch.empty((len(light) + 1, *light.shape[1:]), dtype=light.dtype, device=light.device)
        torch.div(upstream, self._norm, out=together[:-1])
        # The denominator's own share: what brightens all of a place changes nothing there.
        torch.sum(together[:-1] * out, dim=0, out=together[-1])
        gradient, in_variance = torch.zeros_like(light), torch.zeros_like(light[0])
        for k, tent in self._levels:
            back = together if k == 0 else self._rung(k).adjoint(together)
            self._gathered(back, light, gradient, in_variance, tent)
        return gradient, in_variance if self._free is None else in_variance * self._free

    def _rung(self, rung: int) -> BlurOperator:
        v = self._place
        return _rung(rung, v.shape[0], v.shape[1], v.dtype, v.device)


def layer_weighed(light: Tensor, variance: Tensor, tent: Tent) -> Tensor:
    """[C + 1, h, w] a level's share of the light, and its weights, in plain torch."""
    r0, r1, f0, f1 = tent
    weight = torch.minimum(r0 + r1 * variance, f0 + f1 * variance).clamp(min=0.0)[None]
    return torch.cat([weight * light, weight])


def layer_gathered(back: Tensor, light: Tensor, variance: Tensor, tent: Tent, gradients: tuple[Tensor, Tensor]) -> None:
    """Adds a level's part to the gradients in light and variance, in plain torch; see `LayeredBlur`."""
    r0, r1, f0, f1 = tent
    rising, falling = r0 + r1 * variance, f0 + f1 * variance
    gradients[0].add_(torch.minimum(rising, falling).clamp(min=0.0) * back[:-1])
    share = (back[:-1] * light).sum(dim=0) - back[-1]
    steepness = torch.where(rising < falling, variance.new_tensor(r1), variance.new_tensor(f1))
    gradients[1].add_(steepness * (torch.minimum(rising, falling) >= 0) * share)


def layer_returned(
    together: Tensor, seen: Tensor | None, behind: tuple[Tensor, Tensor] | None, hides: Tensor
) -> Tensor:
    """What comes back to a level that hides others, in plain torch; see `Backend`."""
    came = together.clone() if seen is None else seen * together
    if behind is not None:
        planes, part = behind
        hides.add_((together * planes).sum(dim=0) * (part > 0))
        came[-1] -= hides
    came[-1].neg_()
    return came


def tent_of(variances: Sequence[float], k: int) -> Tent:
    """r0, r1, f0, f1 of a level's weight max(0, min(r0 + r1 v, f0 + f1 v))."""
    r1 = 1.0 / (variances[k] - variances[k - 1]) if k > 0 else 0.0
    f1 = 1.0 / (variances[k] - variances[k + 1]) if k + 1 < len(variances) else 0.0
    return 1.0 - r1 * variances[k], r1, 1.0 - f1 * variances[k], f1


@lru_cache(maxsize=32)
def _variances(widest: float) -> list[float]:
    """px^2 of no blur, and of every rung up to a width (px); that of the taps, as sampled Gaussians are narrower."""
    out = [0.0]
    for sigma in LADDER:
        if sigma <= max(widest, LADDER[0]):
            taps = gaussian_taps(sigma)
            out.append(float((taps * (np.arange(len(taps)) - len(taps) // 2) ** 2).sum()))
    return out


@lru_cache(maxsize=128)
def _rung(k: int, height: int, width: int, dtype: torch.dtype, device: torch.device) -> BlurOperator:
    """The blur of rung `k` >= 1 on frames of one size; beyond the frame its edge is repeated."""
    psf = PointSpread(sigma_x=LADDER[k - 1], sigma_y=LADDER[k - 1])
    return BlurOperator(psf, height, width, 0, device, dtype, backend_on(device).one_width)
