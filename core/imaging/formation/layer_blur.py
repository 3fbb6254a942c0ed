"""A blur that grows with the distance, of a view that comes in layers: what is near hides what is behind it.

Which widths belong to a layer, a ladder says (`occluding`): each Gaussian lies between two of its rungs by its own
distance, so that what is thin and out of focus spreads by its own width even where most of the light that passes there
comes from far behind. Layers go on behind what hides them, so that a blurred twig lets through the wall behind it:

    H x = (sum_k V_k C_k) / (sum_k V_k A_k),     V_k = max(0, 1 - sum over j >= k + 2 of A_j)

with C_k = K_k x_k and A_k = K_k a_k of each layer's light and of the share that it covers. Light adds up linearly, and
a twin blends display values: what lies between both where several layers meet in a px goes to those that are seen
there, so that without any blur the light is that of the view.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...colour import srgb_to_linear
from ...compiled import run
from . import layer_kernels
from .occluding import OCCLUDING, Shape, covered, ladder_of, on_rung, rung_of

#: From which layer on one hides those behind it: neighbours share Gaussians.
_HIDES = 2
#: Share of a px below which the colour of what covers it is not asked for: a guard, nothing else was compared.
_LEAST = 1e-3
#: Rows that are worth a call to a thread.
_ROWS = 8


def places(width: Tensor, shape: Shape, size: tuple[int, int]) -> Tensor:
    """[N] where Gaussians lie on the ladder of a frame (height, width), 0 for what is farthest out of focus behind.

    Args:
        width: [N] signed standard deviation, px of the frame: positive where nearer than the sharp plane; wider ones
            than the ladder or the frame allow count as those. Differentiable.
    """
    ladder = width.new_tensor(ladder_of(shape, size))
    signed = (width * width.abs()).clamp(float(ladder[0]), float(ladder[-1]))
    below = (torch.searchsorted(ladder, signed.detach().contiguous(), right=True) - 1).clamp(0, len(ladder) - 2)
    return below + (signed - ladder[below]) / (ladder[below + 1] - ladder[below])


def blurred_layers(planes: Tensor, numbers: Sequence[int], image: Tensor, shape: Shape) -> Tensor:
    """[3, h, w] linear light of a view in layers, each blurred by its rung; differentiable.

    Args:
        planes, numbers: of `core.rendering.RenderedLayers`, rendered at `places`; image: [3, h, w] sRGB, its view.
    """
    if planes.dtype == torch.float32 and planes.device.type == "cpu":
        found: Tensor = _Compiled.apply(planes, image, tuple(numbers), shape)
        return found
    return blurred_layers_in_torch(planes, numbers, image, shape)


def blurred_layers_in_torch(planes: Tensor, numbers: Sequence[int], image: Tensor, shape: Shape) -> Tensor:
    """The same in plain torch, which the compiled kernels mirror."""
    share = planes[:, 3:]
    light = share * srgb_to_linear(planes[:, :3] / share.clamp(min=_LEAST))
    together = dict(zip(numbers, torch.cat([light, share], dim=1), strict=True))
    seen, total = covered(together, _HIDES)
    more = srgb_to_linear(image) - _shown(total)
    spread = {}
    for (k, plane), rung in zip(together.items(), _rungs(numbers, planes, shape), strict=True):
        part = seen[k]
        whole = torch.cat([plane[:3] + plane[3:] * (more if part is None else part * more), plane[3:]])
        spread[k] = on_rung(shape, rung, whole)
    return _shown(covered(spread, _HIDES)[1])


def _shown(total: Tensor) -> Tensor:
    return total[:-1] / total[-1:].clamp(min=OCCLUDING.least)


def _rungs(numbers: Sequence[int], planes: Tensor, shape: Shape) -> list[int]:
    middle = len(ladder_of(shape, (int(planes.shape[2]), int(planes.shape[3])))) // 2
    return [abs(k - middle) for k in numbers]


class _Compiled(torch.autograd.Function):
    """planes [L, 4, h, w], image [3, h, w] -> light [3, h, w]; float32 on the CPU."""

    @staticmethod
    def forward(ctx: Any, planes: Tensor, image: Tensor, numbers: tuple[int, ...], shape: Shape) -> Tensor:
        given, view = planes.detach().contiguous().numpy(), image.detach().contiguous().numpy()
        front = np.searchsorted(np.array(numbers), np.array(numbers) + _HIDES)
        limits = np.float32(_LEAST), np.float32(OCCLUDING.least)
        colours, before = np.empty_like(given[:, :3]), np.empty_like(given)
        height = given.shape[2]
        run(layer_kernels.light_of_layers, height, given, view, front, *limits, colours, before, grain=_ROWS)
        rungs = _rungs(numbers, planes, shape)
        spread = before  # (in its place: all layers of a large photo are gigabytes)
        for plane, rung in zip(torch.from_numpy(spread), rungs, strict=True):
            if rung > 0:
                plane.copy_(rung_of(shape, rung, plane).apply(plane))
        light = np.empty_like(view)
        run(layer_kernels.sum_of_layers, height, spread, front, limits[1], light, grain=_ROWS)
        ctx.kept, ctx.rungs, ctx.shape = (given, view, front, limits, colours, spread, light), rungs, shape
        return torch.from_numpy(light)

    @staticmethod
    def backward(ctx: Any, came: Tensor) -> Any:  # type: ignore[override]
        given, view, front, limits, colours, gradient, light = ctx.kept
        del ctx.kept  # (gradients take the place of what was kept)
        height = given.shape[2]
        sums = gradient, front, limits[1], light, came.contiguous().numpy()
        run(layer_kernels.sum_of_layers_back, height, *sums, grain=_ROWS)
        for plane, rung in zip(torch.from_numpy(gradient), ctx.rungs, strict=True):
            if rung > 0:
                plane.copy_(rung_of(ctx.shape, rung, plane).adjoint(plane))
        in_image = np.empty_like(view)
        rows = given, view, front, *limits, colours, gradient, in_image
        run(layer_kernels.light_of_layers_back, height, *rows, grain=_ROWS)
        return torch.from_numpy(gradient), torch.from_numpy(in_image), None, None
