"""Layers of a view by distance on the `cpu` back end: projected and sorted once, blended layer by layer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..compiled import run
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, RenderedLayers, ScreenStatistics
from .cpu import (
    Floats,
    Projected,
    blend,
    blend_backward,
    depth_splats,
    new_splats,
    numpy_parameters,
    parameters_backward,
    project_and_sort,
    view_vector,
)
from .layers_kernels import add_layer, count_in_layer, list_layer, splats_in_layer
from .projection_kernels import CULL_REASONS
from .reference import layers_with

#: Gaussians, and pairs of one and a tile, that are worth a call to a thread.
_GRAIN = 4096
#: Tiles that are.
_TILES = 8


@dataclass
class _Layer:
    """One layer on its way: its lists, where its slots go in those of all, what it blends over, and what passes it."""

    k: np.float32
    lists: Projected
    slots: NDArray[np.int32]
    behind: tuple[Floats, Floats]
    passed: tuple[Floats, Any] | None = None

    @staticmethod
    def of(p: Projected, place: Floats, number: int, background: Floats | None) -> _Layer:
        """A layer of what was projected; the farthest one is given the background."""
        k, tiles = np.float32(number), len(p.tile_starts) - 1
        starts = np.zeros(tiles + 1, np.int64)
        run(count_in_layer, tiles, p.tile_starts, p.pairs, place, k, starts[1:], grain=_TILES)
        np.cumsum(starts, out=starts)
        own, slots = np.empty((int(starts[-1]), 2), np.int32), np.empty(int(starts[-1]), np.int32)
        run(list_layer, tiles, p.tile_starts, p.pairs, place, k, starts, own, slots, grain=_TILES)
        lists = replace(p, tile_starts=starts, pairs=own, pair_rows=np.empty(len(own), np.int32))
        nothing = np.zeros(3, np.float32)
        behind = (nothing, nothing) if background is None else (background, np.array([1, 0, 0], np.float32))
        return _Layer(k, lists, slots, behind)

    def blended(self, splats: tuple[Floats, Floats], into: Floats) -> None:
        """Blends its splats into planes [4, H, W]."""
        _, height, width = into.shape
        into[:3], *passed, _ = blend(self.lists, splats[0], self.behind[0], width, height)
        into[3] = blend(self.lists, splats[1], self.behind[1], width, height)[0][0]
        self.passed = passed[0], passed[1]

    def back(self, splats: tuple[Floats, Floats], shown: Floats, came: Floats) -> tuple[Floats, Floats]:
        """The slots of both kinds of splats, given the planes [4, H, W] and gradients in them."""
        assert self.passed is not None
        no_alpha = np.zeros(came.shape[1:], np.float32)
        share, in_share = np.zeros((3, *came.shape[1:]), np.float32), np.zeros((3, *came.shape[1:]), np.float32)
        share[0], in_share[0] = shown[3], came[3]
        colours = np.ascontiguousarray(shown[:3]), np.ascontiguousarray(came[:3])
        return (
            blend_backward(self.lists, splats[0], colours[0], *self.passed, (colours[1], no_alpha)),
            blend_backward(self.lists, splats[1], share, *self.passed, (in_share, no_alpha)),
        )


class _RasterizeLayers(torch.autograd.Function):
    """means, log_scales, quaternions, opacity_logits, sh, place, background -> planes, image, alpha, depth."""

    @staticmethod
    def forward(  # noqa: PLR0913  autograd wants its tensors one by one
        ctx: Any,
        camera: Camera,
        settings: RasterSettings,
        screen: ScreenStatistics,
        numbers: list[int],
        means: Tensor,
        log_scales: Tensor,
        quaternions: Tensor,
        opacity_logits: Tensor,
        sh: Tensor,
        place: Tensor,
        background: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        parameters = numpy_parameters(means, log_scales, quaternions, opacity_logits, sh)
        size = camera.width, camera.height
        p = project_and_sort(view_vector(camera, None, settings), parameters, *size, screen.radius.numpy())
        behind, at = background.detach().contiguous().numpy(), place.detach().contiguous().numpy()
        image, transmittance, blended, screen.evaluations = blend(p, p.splats, behind, *size)
        screen.culled = {r: int(n) for r, n in zip(CULL_REASONS[1:], p.reasons[1:], strict=True) if n}
        depth = np.zeros((0, 0), np.float32)
        if settings.depth:
            depth = blend(p, depth_splats(p.splats), np.zeros(3, np.float32), *size)[0][0].copy()
        numbers += layers_with(torch.from_numpy(at[np.diff(p.slot_starts) > 0]))
        planes = np.empty((len(numbers), 4, camera.height, camera.width), np.float32)
        splats = new_splats(len(at)), new_splats(len(at))
        ctx.layers = []
        for i, number in enumerate(numbers):
            layer = _Layer.of(p, at, number, None if i else behind)
            run(splats_in_layer, len(at), p.splats, at, layer.k, *splats, grain=_GRAIN)
            layer.blended(splats, planes[i])
            ctx.layers.append(layer)
        ctx.projected, ctx.screen, ctx.place = p, screen, at
        ctx.view, ctx.planes = (image, transmittance, blended), planes
        return tuple(torch.from_numpy(one) for one in (planes, image, 1.0 - transmittance, depth))  # type: ignore[return-value]

    @staticmethod
    def backward(ctx: Any, d_planes: Tensor, d_image: Tensor, d_alpha: Tensor, d_depth: Tensor) -> Any:  # type: ignore[override]
        p: Projected = ctx.projected
        came, in_image, in_alpha = (gradient.contiguous().numpy() for gradient in (d_planes, d_image, d_alpha))
        image, transmittance, blended = ctx.view
        slots = blend_backward(p, p.splats, image, transmittance, blended, (in_image, in_alpha))
        in_slots = np.zeros(len(p.pairs), np.float32)
        splats = new_splats(len(ctx.place)), new_splats(len(ctx.place))
        for layer, shown, part in zip(ctx.layers, ctx.planes, came, strict=True):
            run(splats_in_layer, len(ctx.place), p.splats, ctx.place, layer.k, *splats, grain=_GRAIN)
            both, own = layer.back(splats, shown, part), layer.lists.pairs
            where = p.splats, ctx.place, layer.k, layer.slots
            run(add_layer, len(own), own, *both, *where, slots, in_slots, grain=_GRAIN)
        outputs, d_screen, _ = parameters_backward(p, slots)
        ctx.screen.mean_gradient = torch.from_numpy(d_screen)
        sums = np.concatenate(([0.0], np.cumsum(in_slots, dtype=np.float64)))
        d_place = (sums[p.slot_starts[1:]] - sums[p.slot_starts[:-1]]).astype(np.float32)
        found = [torch.from_numpy(one) for one in (*outputs, d_place)]
        return (None, None, None, None, *found, _in_background(ctx, came[0], in_image))


def _in_background(ctx: Any, in_farthest: Floats, in_image: Floats) -> Tensor | None:
    """[3] gradient in the background, which the image and the farthest layer are blended over."""
    if not ctx.needs_input_grad[10]:
        return None
    passed = ctx.layers[0].passed[0]
    found = (in_image * ctx.view[1]).sum(axis=(1, 2)) + (in_farthest[:3] * passed).sum(axis=(1, 2))
    return torch.from_numpy(found)


def render_layers_cpu(
    gaussians: Gaussians, camera: Camera, place: Tensor, background: Tensor | None, settings: RasterSettings
) -> RenderedLayers:
    """See `core.rasterizer.render_layers`; float32 on the CPU."""
    screen, numbers = ScreenStatistics(radius=torch.zeros(len(gaussians))), list[int]()
    planes, image, alpha, depth = _RasterizeLayers.apply(  # type: ignore[no-untyped-call]
        camera,
        settings,
        screen,
        numbers,
        *(tensor for _, tensor in gaussians.named()),
        place,
        torch.zeros(3) if background is None else background,
    )
    view = Rendered(image, alpha, depth.detach() if settings.depth else None, screen)
    return RenderedLayers(tuple(numbers), planes, view)
