"""The specification: projection, sorting and blending in plain torch, differentiated by autograd.

Any device, float32 and float64. Slow; the other back ends are measured against it.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..camera import Camera
from ..constants import ALPHA_MAXIMUM, TILE, TRANSMITTANCE_STOP
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, ScreenStatistics
from .projection import Projected, camera_pose, project, select, visible


def render_reference(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, pose: Tensor | None, settings: RasterSettings
) -> Rendered:
    """Renders one view; arguments and result as in `render`."""
    means = gaussians.means
    if pose is None:
        pose = camera_pose(camera, means)
    if background is None:
        background = means.new_zeros(3)

    index, culled = visible(gaussians, camera, pose, settings)
    splats = project(select(gaussians, index), camera, pose, settings)

    radius = torch.zeros(len(gaussians), device=means.device)
    radius[index] = splats.extent.amax(dim=1).float()
    screen = ScreenStatistics(radius, culled)
    if splats.mean.requires_grad:

        def keep_gradient(gradient: Tensor | None) -> None:
            if gradient is not None:
                everywhere = gradient.new_zeros(len(gaussians), 2)
                screen.mean_gradient = everywhere.index_copy(0, index, gradient)

        splats.mean.register_hook(keep_gradient)

    order = depth_order(splats)
    owners, tiles, columns, rows = tile_pairs(splats, order, camera.width, camera.height)
    # One gather for all tiles: its backward pass is one scatter, not one per tile.
    values = torch.cat(
        [splats.mean, splats.conic, splats.opacity[:, None], splats.colour, splats.depth[:, None]], dim=1
    )[owners]
    counts = torch.bincount(tiles, minlength=columns * rows).tolist()
    blended = torch.stack(
        [
            blend(part, tile % columns * TILE, tile // columns * TILE, settings.alpha_minimum)
            for tile, part in enumerate(values.split(counts))
        ]
    )  # [tiles, TILE * TILE, 5]
    screen.evaluations = int(owners.numel()) * TILE * TILE

    planes = blended.reshape(rows, columns, TILE, TILE, 5).permute(4, 0, 2, 1, 3)
    planes = planes.reshape(5, rows * TILE, columns * TILE)[:, : camera.height, : camera.width]
    transmittance = planes[4]
    image = planes[:3] + background[:, None, None] * transmittance
    return Rendered(image, 1 - transmittance, planes[3] if settings.depth else None, screen)


@torch.no_grad()
def depth_order(splats: Projected) -> Tensor:
    """Indices [M] from near to far; ties are broken by content, so input order does not matter."""
    keys = [splats.depth, *splats.mean.unbind(1), splats.opacity, *splats.colour.unbind(1), *splats.conic.unbind(1)]
    order = torch.arange(splats.depth.numel(), device=splats.depth.device)
    for key in reversed(keys):
        order = order[key[order].argsort(stable=True)]
    return order


@torch.no_grad()
def tile_pairs(splats: Projected, order: Tensor, width: int, height: int) -> tuple[Tensor, Tensor, int, int]:
    """All pairs of a splat and a tile that its box touches.

    Returns:
        owners: [P] index of the splat, sorted by tile, then near to far.
        tiles: [P] number of the tile, row by row.
        columns, rows: number of tiles across and down.
    """
    columns, rows = -(-width // TILE), -(-height // TILE)
    limit = splats.mean.new_tensor([columns, rows])
    mean, extent = splats.mean[order], splats.extent[order]
    first = ((mean - extent) / TILE).floor().clamp(min=0).minimum(limit).long()
    last = ((mean + extent) / TILE).ceil().clamp(min=0).minimum(limit).long()
    across, down = (last - first).unbind(1)
    counts = across * down
    pair = torch.repeat_interleave(counts)  # position in `order` of each pair's splat
    within = torch.arange(pair.numel(), device=pair.device) - (counts.cumsum(0) - counts)[pair]
    tiles = (first[pair, 1] + within // across[pair]) * columns + first[pair, 0] + within % across[pair]
    tiles, by_tile = tiles.sort(stable=True)
    return order[pair[by_tile]], tiles, columns, rows


def blend(values: Tensor, left: int, top: int, alpha_minimum: float) -> Tensor:
    """Blends the splats of one tile over each of its pixels (Kerbl et al. 2023, eq. 3).

    Args:
        values: [L, 10] mean (2), conic (3), opacity, colour (3), depth; near to far.
        left, top: the tile's first column and row.

    Returns:
        [TILE * TILE, 5] colour without background (3), blended depth, final transmittance.
    """
    mean, conic, opacity, content = values.split([2, 3, 1, 4], dim=1)
    steps = torch.arange(TILE, device=values.device, dtype=values.dtype) + 0.5
    dy, dx = torch.meshgrid(top + steps, left + steps, indexing="ij")
    dx, dy = dx.reshape(1, -1) - mean[:, :1], dy.reshape(1, -1) - mean[:, 1:]  # [L, pixels]
    xx, xy, yy = conic.split(1, dim=1)
    alpha = opacity * torch.exp(-0.5 * (xx * dx * dx + 2 * xy * dx * dy + yy * dy * dy))
    alpha = alpha.clamp(max=ALPHA_MAXIMUM)
    with torch.no_grad():
        counted = alpha >= alpha_minimum
        counted &= before((1 - alpha * counted).cumprod(dim=0)) >= TRANSMITTANCE_STOP
    alpha = alpha * counted
    passed = (1 - alpha).cumprod(dim=0)
    weights = alpha * before(passed)
    final = passed[-1] if len(values) else dx.new_ones(TILE * TILE)
    return torch.cat([weights.T @ content, final[:, None]], dim=1)


def before(passed: Tensor) -> Tensor:
    """Transmittance in front of each splat, from that behind it, [L, pixels]."""
    return torch.cat([torch.ones_like(passed[:1]), passed[:-1]]) if len(passed) else passed
