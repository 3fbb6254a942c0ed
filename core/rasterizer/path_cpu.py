"""Frames along a camera's path on the `cpu` back end: projected, sorted and laid out in tiles once for all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..compiled import run
from ..constants import TILE, TILE_ROWS
from ..gaussians import Gaussians
from ..rendering import RasterSettings, RenderedPath, ScreenStatistics
from .binning_kernels import begin_pairs, depth_order, list_seen
from .cpu import (
    PARTS,
    Floats,
    Projected,
    blend,
    blend_backward,
    new_splats,
    numpy_parameters,
    parameters_backward,
    view_vector,
)
from .path_kernels import STRAY_WIDTH, count_swept, follow, moved_splats, place_swept
from .projection_kernels import BLOCK, CULL_REASONS, RECORD_WIDTH, project

#: By how much of its larger side a frame is widened where Gaussians are projected: what the path brings into view.
_BESIDE = 0.25
#: Gaussians that are worth a call to a thread.
_GRAIN = 2048


@dataclass
class Followed:
    """Gaussians along a path: what their frames share, and each frame's centres [K, N, 2]."""

    projected: Projected
    centres: Floats


#: A pose [3, 4], flat, as its rotation row by row, then its translation.
_BY_ROWS = [0, 1, 2, 4, 5, 6, 8, 9, 10, 3, 7, 11]


def _projected_once(
    camera: Camera, poses: NDArray[np.float64], parameters: tuple[Floats, ...], settings: RasterSettings, radius: Floats
) -> Followed:
    count, frames = parameters[0].shape[0], len(poses)
    middle = poses[frames // 2]
    margin = int(_BESIDE * max(camera.width, camera.height))
    wide = view_vector(camera.with_margin(margin), middle, settings)
    narrow = view_vector(camera, middle, settings)
    splats, status = new_splats(count), np.empty(count, np.uint8)
    tile_counts, records = np.empty(count, np.int32), np.empty((count, RECORD_WIDTH), np.int16)
    run(project, -(-count // BLOCK), wide, *parameters, splats, status, radius, tile_counts, records, grain=4)
    centres, strays = np.empty((frames, count, 2), np.float32), np.empty((count, STRAY_WIDTH), np.float32)
    rows, flat = np.empty((count, 2), np.int16), np.ascontiguousarray(poses.reshape(frames, 12)[:, _BY_ROWS])
    run(
        follow,
        count,
        parameters[0],
        splats,
        narrow,
        flat,
        status,
        radius,
        centres,
        strays,
        rows,
        tile_counts,
        grain=_GRAIN,
    )
    seen, slot_starts = np.empty(count, np.int32), np.empty(count + 1, np.int64)
    reasons = np.empty(len(CULL_REASONS), np.int64)
    seen = seen[: list_seen(status, tile_counts, seen, slot_starts, reasons)]
    order = np.empty(len(seen), np.int32)
    depth_order(splats, seen, order)
    tiles_x, tiles_y = -(-camera.width // TILE), -(-camera.height // TILE_ROWS)
    chunk = max(1, -(-len(order) // PARTS))
    places = np.empty((PARTS, tiles_y, tiles_x + 1), np.int32)
    starts = np.empty(tiles_x * tiles_y + 1, np.int64)
    width = np.float32(camera.width)
    run(count_swept, PARTS, splats, strays, rows, order, chunk, tiles_x, width, places)
    begin_pairs(places, starts)
    pairs = np.empty((int(starts[-1]), 2), np.int32)
    run(place_swept, PARTS, splats, strays, rows, order, chunk, tiles_x, width, slot_starts, places, pairs)
    least = np.float32(settings.alpha_minimum)
    nothing = np.empty(0, np.int32)
    shared = Projected(wide, parameters, splats, status, reasons, starts, pairs, nothing, slot_starts, tiles_x, least)
    return Followed(shared, centres)


class _RasterizePath(torch.autograd.Function):
    """means, log_scales, quaternions, opacity_logits, sh -> images [K, 3, H, W]."""

    @staticmethod
    def forward(  # noqa: PLR0913  autograd wants its tensors one by one
        ctx: Any,
        camera: Camera,
        poses: NDArray[np.float64],
        background: Tensor,
        settings: RasterSettings,
        screen: ScreenStatistics,
        means: Tensor,
        log_scales: Tensor,
        quaternions: Tensor,
        opacity_logits: Tensor,
        sh: Tensor,
    ) -> Tensor:
        parameters = numpy_parameters(means, log_scales, quaternions, opacity_logits, sh)
        found = _projected_once(camera, poses, parameters, settings, screen.radius.numpy())
        shared, size = found.projected, (camera.width, camera.height)
        culled = zip(CULL_REASONS[1:], shared.reasons[1:], strict=True)
        screen.culled = {reason: int(n) for reason, n in culled if n}
        behind, splats = background.detach().contiguous().numpy(), new_splats(len(shared.status))
        images = np.empty((len(poses), 3, camera.height, camera.width), np.float32)
        ctx.kept = []
        for k in range(len(poses)):
            run(moved_splats, len(splats), shared.splats, found.centres[k], splats, grain=_GRAIN)
            frame = replace(shared, pair_rows=np.empty(len(shared.pairs), np.int32))
            images[k], transmittance, blended, evaluations = blend(frame, splats, behind, *size)
            screen.evaluations += evaluations
            ctx.kept.append((frame, transmittance, blended))
        ctx.found, ctx.screen, ctx.images = found, screen, images
        return torch.from_numpy(images)

    @staticmethod
    def backward(ctx: Any, d_images: Tensor) -> Any:  # type: ignore[override]
        shared: Projected = ctx.found.projected
        count, came = len(shared.status), d_images.contiguous().numpy()
        no_alpha = np.zeros(came.shape[2:], np.float32)
        splats, slots = new_splats(count), None  # (moved again: those of all frames would fill a large set's memory)
        for k, (frame, transmittance, blended) in enumerate(ctx.kept):
            run(moved_splats, count, shared.splats, ctx.found.centres[k], splats, grain=_GRAIN)
            slots = blend_backward(frame, splats, ctx.images[k], transmittance, blended, (came[k], no_alpha), slots)
        assert slots is not None  # (a path has a frame)
        outputs, d_screen, _ = parameters_backward(shared, slots)
        ctx.screen.mean_gradient = torch.from_numpy(d_screen)
        return (None, None, None, None, None, *(torch.from_numpy(o) for o in outputs))


def render_path_cpu(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, poses: Tensor, settings: RasterSettings
) -> RenderedPath:
    """See `core.rasterizer.render_path`; float32 on the CPU."""
    screen = ScreenStatistics(radius=torch.zeros(len(gaussians)))
    images = _RasterizePath.apply(  # type: ignore[no-untyped-call]
        camera,
        poses.detach().double().numpy(),
        torch.zeros(3) if background is None else background,
        settings,
        screen,
        *(tensor for _, tensor in gaussians.named()),
    )
    return RenderedPath(images, (screen,))
