"""A blur whose width differs from px to px, with occlusion: what is near hides the blur behind it.

Every px has a signed width: positive in front of the sharp plane, negative behind it, so that it orders px by depth.
On a ladder of signed widths, level k spreads its share of the light, C_k = K_k (w_k x), and of the frame it covers,
A_k = K_k w_k. Levels in front hide it, but for the next one, which shares px with it (w_k are tents that overlap):

    H x = (sum_k V_k C_k) / (sum_k V_k A_k),     V_k = max(0, 1 - sum over j >= k + 2 of A_j)

A finer ladder hides from k + 3 on: what is nearer is one slope with what it would hide.

So a blurred background does not bleed over a sharp foreground, and a blurred foreground lets through what is behind its
edge. What no px of the frame shows, as it lies behind, is taken for what is seen beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...devices import Tent, backend_on
from ...numbers import BY_DEFINITION, number
from ..operator import BlurOperator
from ..psf import PointSpread
from .layered import LADDER, LAYERED, LadderBlur, layer_returned, tent_of

#: What a point of light becomes: the image of a lens's round hole, or a Gaussian.
Shape = Literal["disk", "gaussian"]
#: From which level on a level hides those behind it.
_HIDES: dict[Shape, int] = {"disk": 2, "gaussian": 3}


@dataclass(frozen=True)
class OccludingSettings:
    """Numbers of a blur with occlusion."""

    widest: float = number(
        1 / 30, "share of the frame's shorter side", "standard deviation; beyond, a depth is wrong rather than the lens"
    )
    subdivided: int = number(16, "count", "parts along a px that a disk's edge is summed over", BY_DEFINITION)
    finer: float = number(
        1.25,
        "ratio",
        "of a Gaussian's neighbouring rungs: half-way between two 0.01 of the contrast is passed too much",
        "sharp pictures and true depths of five views behind rendered glass, against the photos: with 1.6 and 1.4"
        " 40.4 and 40.7 dB, 1.2 (and hiding from the third on) 40.8, this 40.8",
    )
    finer_rungs: int = number(18, "count", "of that ladder, up to 22 px; only those that a frame needs cost anything")
    rounded: float = number(1e-5, "share", "a px's weight in a level that is zero but for rounding", BY_DEFINITION)
    least: float = number(1e-4, "share", "of a px that must be covered by something, or it keeps its own light")


OCCLUDING = OccludingSettings()


def rungs(shape: Shape) -> tuple[float, ...]:
    """Standard deviations of the ladder, px of the frame."""
    if shape == "disk":
        return LADDER
    return tuple(LAYERED.first * OCCLUDING.finer**k for k in range(OCCLUDING.finer_rungs))


def disk(sigma: float, subdivided: int = OCCLUDING.subdivided) -> NDArray[np.float64]:
    """[K, K] samples of an even disk of standard deviation `sigma` px (diameter 4 sigma), averaged over each px."""
    reach = int(np.ceil(2.0 * sigma))
    offset = (np.arange(subdivided) + 0.5) / subdivided - 0.5
    x = (np.arange(-reach, reach + 1)[:, None] + offset[None, :]).ravel()
    inside = (x[:, None] ** 2 + x[None, :] ** 2 <= (2.0 * sigma) ** 2).astype(float)
    side = 2 * reach + 1
    kernel = inside.reshape(side, subdivided, side, subdivided).mean(axis=(1, 3))
    return np.asarray(kernel / kernel.sum())


@lru_cache(maxsize=64)
def _spread(shape: Shape, sigma: float) -> PointSpread:
    return PointSpread("file", samples=disk(sigma)) if shape == "disk" else PointSpread(sigma_x=sigma, sigma_y=sigma)


def _variance(shape: Shape, sigma: float) -> float:
    """Of the taps, px^2."""
    kernel = _spread(shape, sigma).kernel()
    return float(kernel.sum(axis=0) @ (np.arange(kernel.shape[1]) - kernel.shape[1] // 2) ** 2)


@lru_cache(maxsize=64)
def _ladder(shape: Shape, widest: float) -> list[float]:
    """Signed variances of the levels, px^2, from the farthest to the nearest; those of the taps."""
    found: list[float] = []
    for sigma in rungs(shape):
        if not found or sigma <= widest:
            found.append(_variance(shape, sigma))
    return [*(-v for v in reversed(found)), 0.0, *found]


def ladder_of(shape: Shape, size: tuple[int, int]) -> list[float]:
    """Signed variances (px^2) of the levels of a frame (height, width), from the farthest to the nearest."""
    widest = OCCLUDING.widest if shape == "disk" else LAYERED.widest
    return _ladder(shape, widest * min(size))


def on_rung(shape: Shape, rung: int, planes: Tensor) -> Tensor:
    """Planes [C, h, w] blurred by a rung, 0 for none; differentiable."""
    return planes if rung == 0 else rung_of(shape, rung, planes)(planes)


def rung_of(shape: Shape, rung: int, planes: Tensor) -> BlurOperator:
    """The blur of rung `rung` >= 1 on planes [C, h, w]."""
    _, height, width = planes.shape
    return _rung(shape, rung, height, width, planes.dtype, planes.device)


@lru_cache(maxsize=128)
def _rung(shape: Shape, rung: int, height: int, width: int, dtype: torch.dtype, device: torch.device) -> BlurOperator:
    """The blur of rung `rung` >= 1 on frames of one size; beyond the frame its edge is repeated."""
    evaluation = backend_on(device).one_width if shape == "gaussian" else "auto"
    return BlurOperator(_spread(shape, rungs(shape)[rung - 1]), height, width, 0, device, dtype, evaluation)


def even_blur(light: Tensor, sigma: float, shape: Shape) -> tuple[Tensor, float]:
    """Light [C, h, w] blurred alike everywhere by about `sigma` px of the ladder, and the variance (px^2) of that."""
    if sigma == 0.0:
        return light, 0.0
    rung = rungs(shape).index(sigma) + 1
    _, height, width = light.shape
    blurred = _rung(shape, rung, height, width, light.dtype, light.device).apply(light)
    return blurred, _variance(shape, sigma)


class OccludingBlur(LadderBlur):
    """The blur for one map of signed widths.

    Args:
        width: [h, w] standard deviation, px of the frame: positive where nearer than the sharp plane, negative behind
            it; what is wider than the ladder or the frame allow counts as that.
    """

    def __init__(self, width: Tensor, shape: Shape) -> None:
        ladder = ladder_of(shape, (int(width.shape[0]), int(width.shape[1])))
        signed = (width * width.abs()).clamp(ladder[0], ladder[-1]).contiguous()
        lowest, highest = (float(v) for v in torch.aminmax(signed.detach()))
        self.identity = max(-lowest, highest) < LAYERED.invisible**2
        if self.identity:
            return
        first = max(i for i, v in enumerate(ladder) if v <= lowest or i == 0)
        last = max(1, min(i for i, v in enumerate(ladder) if v >= highest or i == len(ladder) - 1))
        first = min(first, last - 1)
        self._shape, self._hides, self._place, self._width = shape, _HIDES[shape], signed, width.detach()
        self._free = width.detach().square() <= ladder[-1]
        middle = len(ladder) // 2
        self._levels = [(abs(k - middle), tent_of(ladder[first : last + 1], k - first)) for k in range(first, last + 1)]
        self._planes: list[Tensor] = []
        self._seen: list[Tensor | None] = []
        self._norm: Tensor | None = None

    def apply(self, light: Tensor) -> Tensor:
        """[C, h, w] -> [C, h, w], differentiable in the light and in the widths."""
        if self.identity:
            return light
        planes = [self._spread(rung, self._weighed(light, tent)) for rung, tent in self._levels]
        seen, norm, total = self._covering(planes)
        if not total.requires_grad:
            self._planes, self._seen, self._norm = planes, seen, norm
        return total[:-1] / norm

    def apply_rows(self, light: Tensor, rows: range) -> Tensor:
        """[C, R, w] some rows of `apply(light)`, without gradient, in little more than their share of its time."""
        some = slice(rows.start, rows.stop, rows.step)
        if self.identity:
            return light[:, some]
        weighed = [(rung, self._weighed(light, tent)) for rung, tent in self._levels]
        planes = [w[:, some] if rung == 0 else self._rung(rung).apply_rows(w, rows) for rung, w in weighed]
        _, norm, total = self._covering(planes)
        return total[:-1] / norm

    def _covering(self, planes: list[Tensor]) -> tuple[list[Tensor | None], Tensor, Tensor]:
        """How much of each level's planes [C + 1, R, w] is seen, what to divide by [1, R, w], and the sum of them."""
        seen, total = covered(dict(enumerate(planes)), self._hides)
        return list(seen.values()), total[-1:].clamp(min=OCCLUDING.least), total

    def adjoint(self, upstream: Tensor, light: Tensor, out: Tensor) -> tuple[Tensor, Tensor | None]:
        """The transpose of `apply`, and the gradient in the widths [h, w] (None: they change nothing).

        Args:
            upstream: [C, h, w] gradient of a loss in `out`, which is `apply(light)`, called before.
        """
        if self.identity:
            return upstream, None
        assert self._norm is not None
        together = torch.empty((len(light) + 1, *light.shape[1:]), dtype=light.dtype, device=light.device)
        together[:-1] = upstream / self._norm
        together[-1] = -(together[:-1] * out).sum(dim=0)
        gradient, in_signed = torch.zeros_like(light), torch.zeros_like(light[0])
        hides = torch.zeros_like(light[0])  # gradient in what the levels behind are covered by
        for k, (rung, tent) in enumerate(self._levels):
            came = self._returned(k, together, hides)
            if rung > 0:
                blur = self._rung(rung)
                came = blur.adjoint_at(came, self._in_level(tent)) if blur.partial else blur.adjoint(came)
            self._gathered(came, light, gradient, in_signed, tent)
        return gradient, 2.0 * self._width.abs() * in_signed * self._free

    def _returned(self, k: int, together: Tensor, hides: Tensor) -> Tensor:
        """What comes back to a level before its blur; see `Backend.layer_returned`."""
        behind = None
        if k >= self._hides:
            part = self._seen[k - self._hides]
            assert part is not None
            behind = self._planes[k - self._hides], part
        back = backend_on(together.device).layer_returned if together.dtype == torch.float32 else layer_returned
        return back(together, self._seen[k], behind, hides)

    def _in_level(self, tent: Tent) -> Tensor:
        """[h, w] where the light or the width of a px matters to a level."""
        r0, r1, f0, f1 = tent
        weight = torch.minimum(r0 + r1 * self._place, f0 + f1 * self._place)
        return (weight > OCCLUDING.rounded) | ((weight > -OCCLUDING.rounded) & self._free)

    def _rung(self, rung: int) -> BlurOperator:
        v = self._place
        return _rung(self._shape, rung, v.shape[0], v.shape[1], v.dtype, v.device)


def covered(planes: Mapping[int, Tensor], hides: int) -> tuple[dict[int, Tensor | None], Tensor]:
    """How much of each level's planes [C + 1, R, w] is seen, [R, w] (None: all), and the sum of what is.

    Args:
        planes: by level, from the farthest on, the share that they cover last; hides: from which level on one hides.
    """
    seen: dict[int, Tensor | None] = {}
    front: Tensor | None = None
    waiting = sorted(planes)
    for k in sorted(planes, reverse=True):
        while waiting and waiting[-1] >= k + hides:
            nearer = planes[waiting.pop()][-1]
            front = nearer if front is None else front + nearer
        seen[k] = None if front is None else (1.0 - front).clamp(min=0.0)  # (None: nothing can be in front)
    total: Tensor | None = None
    for k in sorted(planes):
        part = seen[k]
        visible = planes[k] if part is None else part * planes[k]
        total = visible if total is None else total + visible
    assert total is not None
    return dict(sorted(seen.items())), total


def unknown(rows: int) -> tuple[Tensor, Tensor]:
    """[rows] no strength, and a focus of 1 / (median depth)."""
    return torch.zeros(rows), torch.ones(rows)


def columns(*values: Sequence[float]) -> list[Tensor]:
    """[rows] each."""
    return [torch.tensor(list(value), dtype=torch.float32) for value in values]


def scalars(*values: float) -> list[Tensor]:
    """[] each."""
    return [torch.tensor(value) for value in values]


def plane_of(distance: Tensor, tilt: Tensor) -> Tensor:
    """[3] m of the plane m X = 1 at a depth on the axis, with a normal that leans by tangents [2]."""
    return torch.cat([tilt, tilt.new_ones(1)]) / distance.clamp(min=1e-6)


def pulled_back(function: Callable[..., Tensor], given: Sequence[Tensor], upstream: Tensor) -> tuple[Tensor, ...]:
    """Gradients in what a function is given, given that in its value."""
    with torch.enable_grad():
        free = [value.detach().requires_grad_() for value in given]
        total = (function(*free) * upstream).sum()
    return torch.autograd.grad(total, free)
