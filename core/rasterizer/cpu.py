"""The `cpu` back end: the numba kernels as a torch autograd function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..compiled import run
from ..constants import TILE, TILE_ROWS
from ..errors import DeviceError
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, ScreenStatistics
from .binning_kernels import begin_pairs, count_pairs, depth_order, list_seen, place_pairs
from .blending_kernels import backward_tiles, blend_tiles
from .projection_backward_kernels import project_backward
from .projection_kernels import BLOCK, CULL_REASONS, RECORD_WIDTH, SEEN, project
from .shape_kernels import V_ALPHA_MINIMUM, V_CENTRE, V_T, VIEW_LENGTH
from .splat_kernels import DEPTH, M_RED, RED, SLOT_WIDTH, SPLAT_WIDTH

#: The depth order is cut into this many parts for the parallel counting sort; a constant, so that
#: nothing depends on the number of threads (nothing does: the sort is stable).
PARTS = 16

Floats = NDArray[np.float32]


@dataclass
class Projected:
    """What the forward pass leaves for the backward pass (numpy views on torch memory)."""

    view: NDArray[np.float64]
    parameters: tuple[Floats, ...]
    splats: Floats  # [N, 16]
    status: NDArray[np.uint8]  # [N]
    reasons: NDArray[np.int64]  # how many have which status
    tile_starts: NDArray[np.int64]
    pairs: NDArray[np.int32]  # [P, 2] Gaussian and gradient slot
    pair_rows: NDArray[np.int32]  # [P] what blending finds
    slot_starts: NDArray[np.int64]  # [N + 1]
    tiles_x: int
    alpha_minimum: np.float32


def view_vector(camera: Camera, pose: NDArray[np.float64] | None, settings: RasterSettings) -> NDArray[np.float64]:
    """Camera and settings as the kernels take them, [25] float64."""
    view = np.empty(VIEW_LENGTH, np.float64)
    view[:9] = (camera.rotation if pose is None else pose[:, :3]).reshape(9)
    view[9:12] = camera.translation if pose is None else pose[:, 3]
    view[V_CENTRE:] = -(view[:9].reshape(3, 3).T @ view[V_T : V_T + 3])
    view[12:V_CENTRE] = (
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        camera.width,
        camera.height,
        settings.near,
        settings.low_pass,
        float(settings.antialias),
        settings.alpha_minimum,
    )
    return view


def new_splats(count: int) -> Floats:
    """Room for `count` splats, each on a cache line of its own."""
    room = np.empty((count + 1) * SPLAT_WIDTH, np.float32)
    skip = -room.ctypes.data % 64 // 4
    return room[skip : skip + count * SPLAT_WIDTH].reshape(count, SPLAT_WIDTH)


def numpy_parameters(*tensors: Tensor) -> tuple[Floats, ...]:
    """A twin's tensors as the kernels take them."""
    return tuple(t.detach().contiguous().numpy() for t in tensors)


def project_and_sort(
    view: NDArray[np.float64], parameters: tuple[Floats, ...], width: int, height: int, radius: Floats
) -> Projected:
    """Projection, depth order and the tiles' lists."""
    count = parameters[0].shape[0]
    splats = new_splats(count)
    status = np.empty(count, np.uint8)
    tile_counts = np.empty(count, np.int32)
    records = np.empty((count, RECORD_WIDTH), np.int16)
    run(project, -(-count // BLOCK), view, *parameters, splats, status, radius, tile_counts, records, grain=4)
    seen, slot_starts = np.empty(count, np.int32), np.empty(count + 1, np.int64)
    reasons = np.empty(len(CULL_REASONS), np.int64)
    seen = seen[: list_seen(status, tile_counts, seen, slot_starts, reasons)]
    order = np.empty(len(seen), np.int32)
    depth_order(splats, seen, order)

    tiles_x, tiles_y = -(-width // TILE), -(-height // TILE_ROWS)
    chunk = max(1, -(-len(order) // PARTS))
    places = np.empty((PARTS, tiles_y, tiles_x + 1), np.int32)
    tile_starts = np.empty(tiles_x * tiles_y + 1, np.int64)
    run(count_pairs, PARTS, splats, records, order, chunk, tiles_x, np.float32(width), places)
    begin_pairs(places, tile_starts)
    pairs = np.empty((int(tile_starts[-1]), 2), np.int32)
    run(place_pairs, PARTS, splats, records, order, chunk, tiles_x, np.float32(width), slot_starts, places, pairs)
    return Projected(
        view,
        parameters,
        splats,
        status,
        reasons,
        tile_starts,
        pairs,
        np.empty(len(pairs), np.int32),
        slot_starts,
        tiles_x,
        np.float32(view[V_ALPHA_MINIMUM]),
    )


def blend(p: Projected, splats: Floats, background: Floats, width: int, height: int) -> tuple[Any, ...]:
    """Blends every tile of a view front to back.

    Args:
        p: tiles and their lists; `pair_rows` is written, for the way back.
        splats: [N, SPLAT_WIDTH] float32 as they are blended: projected Gaussians, maybe moved or of other colours.
        background: [3] float32 sRGB.

    Returns:
        Image [3, H, W] sRGB and transmittance [H, W] float32, how many of its list each tile blended [tiles] int32, and
        how many pairs of a Gaussian and a px were evaluated.
    """
    image = np.empty((3, height, width), np.float32)
    transmittance = np.empty((height, width), np.float32)
    tiles = len(p.tile_starts) - 1
    blended = np.empty(tiles, np.int32)
    evaluations = np.empty(tiles, np.int64)
    run(
        blend_tiles,
        tiles,
        splats,
        p.tile_starts,
        p.pairs,
        background,
        p.alpha_minimum,
        p.tiles_x,
        image,
        transmittance,
        blended,
        evaluations,
        p.pair_rows,
        grain=8,
    )
    return image, transmittance, blended, int(evaluations.sum())


def blend_backward(
    p: Projected,
    splats: Floats,
    image: Floats,
    transmittance: Floats,
    blended: Any,
    gradients: tuple[Floats, Floats],
    to: Floats | None = None,
) -> Floats:
    """Takes gradients of a view back to its pairs of a Gaussian and a tile.

    Args:
        p, splats: as `blend` was given them; image, transmittance, blended: what it returned.
        gradients: in the image [3, H, W], and in alpha [H, W] float32.
        to: what another view of the same pairs returned; gradients are added to it.

    Returns:
        [P + 2, SLOT_WIDTH] float32, a row for each pair; the last two are zero.
    """
    slots = to
    if slots is None:  # (two rows more, because vectors are read whole)
        slots = np.empty((len(p.pairs) + 2, SLOT_WIDTH), np.float32)
        slots[-2:] = 0.0
    run(
        backward_tiles,
        len(p.tile_starts) - 1,
        splats,
        p.tile_starts,
        p.pairs,
        p.alpha_minimum,
        p.tiles_x,
        image,
        transmittance,
        blended,
        p.pair_rows,
        *gradients,
        slots,
        np.float32(to is not None),
        grain=8,
    )
    return slots


def parameters_backward(
    p: Projected, slots: Floats, depth_gradient: Floats = np.zeros(0, np.float32)
) -> tuple[list[Floats], Floats, NDArray[np.float64]]:
    """Takes the gradients of pairs of a Gaussian and a tile back to what was projected.

    Args:
        slots: of `blend_backward`; depth_gradient: [N] in the depths of the centres, empty for none.

    Returns:
        Gradients in the parameters, in their order; in the projected centres [N, 2] px; and in the view [blocks, 12].
    """
    outputs, d_screen = [np.empty_like(one) for one in p.parameters], np.empty((len(p.status), 2), np.float32)
    blocks = -(-len(p.status) // BLOCK)
    d_view = np.empty((blocks, 12), np.float64)
    shared = p.view, *p.parameters, p.status, p.slot_starts, slots, depth_gradient
    run(project_backward, blocks, *shared, *outputs, d_screen, d_view, grain=4)
    return outputs, d_screen, d_view


def depth_splats(splats: Floats) -> Floats:
    """The same splats with their depth for a colour."""
    out = splats.copy()
    out[:, RED] = splats[:, DEPTH]
    out[:, RED + 1 : RED + 3] = 0.0
    return out


class _Rasterize(torch.autograd.Function):
    """means, log_scales, quaternions, opacity_logits, sh, background, pose -> image, alpha, depth."""

    @staticmethod
    def forward(  # noqa: PLR0913  autograd wants its tensors one by one
        ctx: Any,
        camera: Camera,
        settings: RasterSettings,
        screen: ScreenStatistics,
        means: Tensor,
        log_scales: Tensor,
        quaternions: Tensor,
        opacity_logits: Tensor,
        sh: Tensor,
        background: Tensor,
        pose: Tensor | None,
    ) -> tuple[Tensor, Tensor, Tensor]:
        parameters = numpy_parameters(means, log_scales, quaternions, opacity_logits, sh)
        view = view_vector(camera, None if pose is None else pose.detach().double().numpy(), settings)
        projected = project_and_sort(view, parameters, camera.width, camera.height, screen.radius.numpy())
        behind = background.detach().contiguous().numpy()
        image, transmittance, blended, screen.evaluations = blend(
            projected, projected.splats, behind, camera.width, camera.height
        )
        culled = zip(CULL_REASONS[1:], projected.reasons[1:], strict=True)
        screen.culled = {reason: int(n) for reason, n in culled if n}
        depth = np.zeros((0, 0), np.float32)
        if settings.depth:
            far = depth_splats(projected.splats)
            depth = blend(projected, far, np.zeros(3, np.float32), camera.width, camera.height)[0][0].copy()
        ctx.projected, ctx.screen, ctx.settings = projected, screen, settings
        ctx.image, ctx.transmittance, ctx.blended = image, transmittance, blended
        ctx.depth = depth
        ctx.pose_dtype = None if pose is None else pose.dtype
        return torch.from_numpy(image), torch.from_numpy(1.0 - transmittance), torch.from_numpy(depth)

    @staticmethod
    def backward(ctx: Any, d_image: Tensor, d_alpha: Tensor, d_depth: Tensor) -> Any:  # type: ignore[override]
        p: Projected = ctx.projected
        d_image_array = d_image.contiguous().numpy()
        gradients = d_image_array, d_alpha.contiguous().numpy()
        slots = blend_backward(p, p.splats, ctx.image, ctx.transmittance, ctx.blended, gradients)
        depth_gradient = np.zeros(0, np.float32)
        if ctx.settings.depth and bool(d_depth.any()):
            shape = ctx.transmittance.shape
            stack = np.zeros((3, *shape), np.float32)
            stack[0] = ctx.depth
            gradients = np.zeros((3, *shape), np.float32), np.zeros(shape, np.float32)
            gradients[0][0] = d_depth.numpy()
            more = blend_backward(p, depth_splats(p.splats), stack, ctx.transmittance, ctx.blended, gradients)
            totals = np.concatenate(([0.0], np.cumsum(more[:, M_RED], dtype=np.float64)))
            depth_gradient = (totals[p.slot_starts[1:]] - totals[p.slot_starts[:-1]]).astype(np.float32)
            more[:, M_RED:] = 0.0
            slots += more
        outputs, d_screen, d_view = parameters_backward(p, slots, depth_gradient)
        ctx.screen.mean_gradient = torch.from_numpy(d_screen)
        d_pose = None
        if ctx.pose_dtype is not None and ctx.needs_input_grad[9]:
            total = d_view.sum(axis=0)
            d_pose = torch.from_numpy(np.concatenate([total[:9].reshape(3, 3), total[9:].reshape(3, 1)], axis=1))
            d_pose = d_pose.to(ctx.pose_dtype)
        d_background = None
        if ctx.needs_input_grad[8]:
            d_background = torch.from_numpy((d_image_array * ctx.transmittance).sum(axis=(1, 2)))
        return (None, None, None, *(torch.from_numpy(o) for o in outputs), d_background, d_pose)


def render_cpu(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, pose: Tensor | None, settings: RasterSettings
) -> Rendered:
    """See `core.rasterizer.render`; float32 on the CPU.

    Raises:
        DeviceError: the tensors are not float32 on the CPU.
    """
    if gaussians.means.device.type != "cpu" or gaussians.means.dtype != torch.float32:
        raise DeviceError(
            "The cpu rasterizer takes float32 tensors on the CPU",
            "Use the back end 'reference' for float64, 'gpu' for tensors on a graphics card",
        )
    screen = ScreenStatistics(radius=torch.zeros(len(gaussians)))
    behind = torch.zeros(3) if background is None else background
    image, alpha, depth = _Rasterize.apply(  # type: ignore[no-untyped-call]
        camera,
        settings,
        screen,
        gaussians.means,
        gaussians.log_scales,
        gaussians.quaternions,
        gaussians.opacity_logits,
        gaussians.sh,
        behind,
        pose,
    )
    return Rendered(image, alpha, depth if settings.depth else None, screen)


__all__ = ["SEEN", "render_cpu"]
