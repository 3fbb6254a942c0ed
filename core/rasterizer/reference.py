"""The specification: projection, sorting and blending in plain torch, differentiated by autograd.

Any device, float32 and float64. Slow; the other back ends are measured against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..camera import Camera
from ..constants import ALPHA_MAXIMUM, TILE, TRANSMITTANCE_STOP
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, RenderedLayers, ScreenStatistics
from .projection import Projected, camera_pose, project, select, visible


def render_reference(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, pose: Tensor | None, settings: RasterSettings
) -> Rendered:
    """Renders one view; arguments and result as in `render`."""
    seen = _Seen.of(gaussians, camera, camera_pose(camera, gaussians.means) if pose is None else pose, settings)
    splats = seen.splats
    planes = seen.blended(splats.opacity, torch.cat([splats.colour, splats.depth[:, None]], dim=1))
    transmittance = planes[4]
    image = planes[:3] + _over(background, gaussians)[:, None, None] * transmittance
    return Rendered(image, 1 - transmittance, planes[3] if settings.depth else None, seen.screen)


def render_layers_reference(
    gaussians: Gaussians, camera: Camera, place: Tensor, background: Tensor | None, settings: RasterSettings
) -> RenderedLayers:
    """Renders one view in layers; arguments and result as in `render_layers`."""
    seen = _Seen.of(gaussians, camera, camera_pose(camera, gaussians.means), settings)
    splats, place, behind = seen.splats, place[seen.index], _over(background, gaussians)
    planes = seen.blended(splats.opacity, torch.cat([splats.colour, splats.depth[:, None]], dim=1))
    image = planes[:3] + behind[:, None, None] * planes[4]
    depth = planes[3].detach() if settings.depth else None
    view = Rendered(image, 1 - planes[4], depth, seen.screen)
    numbers = layers_with(place.detach())
    layers: list[Tensor] = []
    for k in numbers:
        off = (place - k).abs()
        share = torch.where(off < 1, 1 - off, 0.0)[:, None]
        shown = torch.where(place.detach() < k + 2, splats.opacity, 0.0)
        layer = seen.blended(shown, torch.cat([share * splats.colour, share], dim=1))
        if not layers:
            layer = torch.cat([layer[:3] + behind[:, None, None] * layer[4], layer[3:4] + layer[4:]])
        layers.append(layer[:4])
    return RenderedLayers(numbers, torch.stack(layers), view)


def layers_with(place: Tensor) -> tuple[int, ...]:
    """Which layers Gaussians at these places [M] show in; the farthest one where there are none."""
    found = torch.unique(torch.cat([place.floor(), place.ceil()]))
    return tuple(int(k) for k in found.tolist()) or (0,)


@dataclass(frozen=True)
class _Seen:
    """What a camera sees, projected and sorted.

    Attributes:
        index: [M] which of the Gaussians; splats: they, projected; pairs: of `tile_pairs`.
    """

    camera: Camera
    settings: RasterSettings
    index: Tensor
    splats: Projected
    pairs: tuple[Tensor, Tensor, int, int]
    screen: ScreenStatistics

    @staticmethod
    def of(gaussians: Gaussians, camera: Camera, pose: Tensor, settings: RasterSettings) -> _Seen:
        index, culled = visible(gaussians, camera, pose, settings)
        splats = project(select(gaussians, index), camera, pose, settings)
        radius = torch.zeros(len(gaussians), device=gaussians.means.device)
        radius[index] = splats.extent.amax(dim=1).float()
        screen = ScreenStatistics(radius, culled)
        if splats.mean.requires_grad:

            def keep_gradient(gradient: Tensor | None) -> None:
                if gradient is not None:
                    everywhere = gradient.new_zeros(len(gaussians), 2)
                    screen.mean_gradient = everywhere.index_copy(0, index, gradient)

            splats.mean.register_hook(keep_gradient)
        pairs = tile_pairs(splats, depth_order(splats), camera.width, camera.height)
        screen.evaluations = int(pairs[0].numel()) * TILE * TILE
        return _Seen(camera, settings, index, splats, pairs, screen)

    def blended(self, opacity: Tensor, content: Tensor) -> Tensor:
        """[5, H, W] what is blended of content [M, 4], and last the transmittance, with these opacities [M]."""
        owners, tiles, columns, rows = self.pairs
        # One gather for all tiles: its backward pass is one scatter, not one per tile.
        values = torch.cat([self.splats.mean, self.splats.conic, opacity[:, None], content], dim=1)[owners]
        counts = torch.bincount(tiles, minlength=columns * rows).tolist()
        blended = torch.stack(
            [
                blend(part, tile % columns * TILE, tile // columns * TILE, self.settings.alpha_minimum)
                for tile, part in enumerate(values.split(counts))
            ]
        )  # [tiles, TILE * TILE, 5]
        planes = blended.reshape(rows, columns, TILE, TILE, 5).permute(4, 0, 2, 1, 3)
        return planes.reshape(5, rows * TILE, columns * TILE)[:, : self.camera.height, : self.camera.width]


def _over(background: Tensor | None, gaussians: Gaussians) -> Tensor:
    return gaussians.means.new_zeros(3) if background is None else background


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
        values: [L, 10] mean (2), conic (3), opacity, content (4: colours and depth, say); near to far.
        left, top: the tile's first column and row.

    Returns:
        [TILE * TILE, 5] blended content (4), without background, and final transmittance.
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
