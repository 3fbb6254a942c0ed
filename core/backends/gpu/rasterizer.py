"""Gaussians and a camera in, an image out, and its gradient: the shaders as a torch autograd function.

Forward: projection, a radix sort by depth, a list of splats for each tile (a second sort), blending, which leaves
checkpoints along the lists where a backward pass may come. Backward: a gradient slot for each pair of a splat and a
tile, all chunks of the lists side by side, then each Gaussian's slots in their order, chained to the parameters. No
two threads add to one number, so the same input gives the same bits, with or without float atomics.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...camera import Camera
from ...constants import FRUSTUM_MARGIN, TILE
from ...errors import DeviceError
from ...gaussians import Gaussians
from ...rasterizer.projection import SMOOTH_ALPHA_EDGE
from ...rasterizer.projection_kernels import CULL_REASONS
from ...rendering import RasterSettings, Rendered, ScreenStatistics
from .card import Card, Memory, card
from .layout import CHECKPOINT, CHUNK, GROUP, LONG_LISTS, POSE_SUMS, REASONS, SLOT_WIDTH
from .operands import unused
from .sorting import prefix_sums, sort
from .tensors import CardTensor, empty, for_shader, register, written

#: Bytes of a projected Gaussian (`splat.wgsl`).
_SPLAT = 64
#: Where the view says to the backward pass of which outputs gradients came, in bytes (`view.wgsl`).
_CAME = 4 * (8 * 4 + 3)
#: Bytes of a chunk's entry (`chunks.wgsl`).
_CHUNK = 16


@dataclass
class Projected:
    """What the forward pass leaves on the card for the backward pass.

    Attributes:
        view: the shaders' uniform; tiles: across and down; count: of Gaussians; harmonics: of each.
        ranges: each tile's part of `lists`; slots: each Gaussian's range of gradient slots.
        pairs: of a splat and a tile.
        chunks: the parts of `lists` that groups of the backward pass take; room: for so many, most of them used.
        checkpoints: what pixels held where a chunk begins; empty, as `chunks`, where no backward pass can come.
    """

    view: bytes
    tiles: tuple[int, int]
    count: int
    harmonics: int
    parameters: tuple[Memory, ...]
    splats: Memory
    lists: Memory
    ranges: Memory
    slots: Memory
    pairs: int
    room: int
    chunks: Memory
    checkpoints: Memory


def view_numbers(
    camera: Camera,
    pose: NDArray[np.float64] | None,
    settings: RasterSettings,
    background: NDArray[np.float32],
    shape: tuple[int, int],
    learns: bool,
) -> bytes:
    """Camera and settings as `view.wgsl` lays them out.

    Args:
        pose: [3, 4] world to camera; the camera's own if None.
        shape: Gaussians, harmonics of each.
        learns: whether a backward pass may come.
    """
    rotation = camera.rotation if pose is None else pose[:, :3]
    translation = camera.translation if pose is None else pose[:, 3]
    centre = np.linalg.solve(rotation, -translation)
    near = centre.astype(np.float32)
    width, height = camera.width, camera.height
    numbers = np.zeros((10, 4), np.float32)
    numbers[:3, :3], numbers[:3, 3] = rotation, near
    numbers[3, :3] = centre - near
    numbers[4] = camera.fx, camera.fy, camera.cx, camera.cy
    for column, (focal, middle, size) in enumerate(((camera.fx, camera.cx, width), (camera.fy, camera.cy, height))):
        beside = FRUSTUM_MARGIN * size
        numbers[5, 2 * column : 2 * column + 2] = -(middle + beside) / focal, (size - middle + beside) / focal
    numbers[6] = width, height, settings.near, settings.low_pass
    numbers[7] = settings.alpha_minimum, settings.alpha_minimum or SMOOTH_ALPHA_EDGE, settings.antialias, learns
    numbers[8, :3] = background
    numbers[9].view(np.uint32)[:] = *shape, -(-width // TILE), -(-height // TILE)
    return numbers.tobytes()


def project(
    device: Card, view: bytes, parameters: tuple[Memory, ...], shape: tuple[int, int], radius: Memory
) -> tuple[Projected, list[int]]:
    """Projection, depth order and the tiles' lists; and how many Gaussians have which status."""
    count = shape[0]
    across, down = (int(n) for n in np.frombuffer(view, np.uint32)[38:40])
    learns = bool(np.frombuffer(view, np.float32)[31])
    splats, reasons = device.memory(_SPLAT * count), device.memory(4 * REASONS)
    keys, tile_counts, order = (device.memory(4 * count) for _ in range(3))
    places = device.memory(4 * (count + 1))
    device.clear(reasons)
    device.for_each("project", count, GROUP, view, *parameters, splats, keys, tile_counts, radius, reasons)
    known = device.fetch(reasons, 4 * REASONS)  # (the card sorts while its numbers come)
    keys, indices = sort(device, keys, None, count, 32)
    number = np.uint32(count).tobytes()
    device.for_each("ties", count, GROUP, number, keys, indices, splats, tile_counts, order, places)
    prefix_sums(device, places, count)
    totals = known().view(np.uint32).tolist()
    pairs = totals[-1]

    slots, ranges = device.memory(8 * count), device.memory(8 * (across * down + 1))
    tiles, owners = (device.memory(4 * pairs) for _ in range(2))
    lists = device.memory(8 * pairs)
    device.for_each("emit", count, GROUP, view, splats, order, places, tiles, owners, slots)
    tiles, numbers = sort(device, tiles, None, pairs, (across * down).bit_length())
    # (each tile has part of a chunk at most, besides whole ones)
    room = pairs // CHUNK + across * down if learns else 0
    chunks = device.memory(_CHUNK * room)
    checkpoints = device.memory(4 * CHECKPOINT * TILE * TILE * (pairs // CHUNK) if learns else 0)
    device.clear(ranges)
    device.clear(chunks)
    device.for_each("tile_lists", pairs, GROUP, np.uint32(pairs).tobytes(), tiles, numbers, owners, lists, ranges)
    projected = Projected(
        view, (across, down), *shape, parameters, splats, lists, ranges, slots, pairs, room, chunks, checkpoints
    )
    return projected, totals[:-1]


def blend(device: Card, p: Projected, outputs: tuple[CardTensor, ...]) -> None:
    """Writes image [3, H, W], transmittance, depth and alpha [H, W], and `p.chunks` and `p.checkpoints`."""
    memories = [output.held.for_card(overwrite=True) for output in outputs]
    device.run("blend", p.tiles, p.view, p.splats, p.lists, p.ranges, p.chunks, p.checkpoints, *memories)
    if p.pairs > LONG_LISTS:  # (the card has nothing to do yet)
        device.send()
    for output in outputs:
        written(output)


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
        learns: bool,
    ) -> tuple[Tensor, Tensor, Tensor]:
        device, size = card(), (camera.height, camera.width)
        parameters = tuple(for_shader(t) for t in (means, log_scales, quaternions, opacity_logits, sh))
        shape = (len(means), int(sh.shape[1]))
        where = None if pose is None else pose.detach().double().cpu().numpy()
        view = view_numbers(camera, where, settings, background.detach().float().cpu().numpy(), shape, learns)
        radius = empty(len(means))
        projected, numbers = project(device, view, parameters, shape, radius.held.for_card(overwrite=True))
        screen.radius = written(radius)
        screen.culled = {reason: n for reason, n in zip(CULL_REASONS[1:], numbers[1:], strict=False) if n}
        screen.evaluations = projected.pairs * TILE * TILE
        image, transmittance, depth, alpha = empty(3, *size), empty(*size), empty(*size), empty(*size)
        blend(device, projected, (image, transmittance, depth, alpha))
        ctx.projected, ctx.screen, ctx.camera, ctx.pose = projected, screen, camera, where
        ctx.seen = image, transmittance, depth
        ctx.pose_like = None if pose is None else pose.detach()
        ctx.behind_like = background.detach()
        ctx.set_materialize_grads(False)
        return CardTensor(image.local, image.held), alpha, CardTensor(depth.local, depth.held)

    @staticmethod
    def backward(ctx: Any, *came: Tensor | None) -> Any:
        p, device = ctx.projected, card()
        transmittance = ctx.seen[1]
        upstream = [None if g is None else for_shader(g) for g in came]
        view = bytearray(p.view)
        struct.pack_into("f", view, _CAME, sum(2**place for place, one in enumerate(upstream) if one is not None))
        slots = device.memory(4 * SLOT_WIDTH * p.pairs)
        known = [for_shader(tensor) for tensor in ctx.seen] + [unused() if one is None else one for one in upstream]
        of_lists = p.splats, p.lists, p.chunks, p.checkpoints
        device.for_each("blend_backward", p.room, 1, bytes(view), *of_lists, *known, slots)
        device.send()  # (the card works while what follows is written)
        widths = (3, 3, 4, 1, 3 * p.harmonics, 2)
        out = empty(p.count * sum(widths))
        blocks = -(-p.count // GROUP)
        of_pose = device.memory(4 * POSE_SUMS * blocks)
        device.for_each(
            "project_backward",
            p.count,
            GROUP,
            p.view,
            *p.parameters,
            p.slots,
            slots,
            out.held.for_card(overwrite=True),
            of_pose,
        )
        written(out)
        starts = np.cumsum((0, *widths)) * p.count
        shapes = ((-1, 3), (-1, 3), (-1, 4), (-1,), (-1, p.harmonics, 3), (-1, 2))
        # (views as torch makes them, but without asking it)
        parts = zip(starts[:-1], starts[1:], shapes, strict=True)
        found = [CardTensor(out.local[a:b].reshape(shape), out.held) for a, b, shape in parts]
        ctx.screen.mean_gradient = found.pop()
        d_pose = d_background = None
        if ctx.pose_like is not None and ctx.needs_input_grad[9]:
            d_pose = _pose_gradient(ctx, device.read(of_pose, 4 * POSE_SUMS * blocks)).to(ctx.pose_like)
        if ctx.needs_input_grad[8]:
            in_image = torch.zeros_like(ctx.seen[0]) if came[0] is None else came[0]
            d_background = (in_image * transmittance).sum(dim=(1, 2)).to(ctx.behind_like)
        return (None, None, None, *found, d_background, d_pose, None)


def _pose_gradient(ctx: Any, raw: NDArray[np.uint8]) -> Tensor:
    """[3, 4] from the groups' sums: of rotation and translation seen from the camera's centre, and of the centre."""
    camera: Camera = ctx.camera
    rotation, shift = (camera.rotation, camera.translation) if ctx.pose is None else (ctx.pose[:, :3], ctx.pose[:, 3])
    sums = raw.view(np.float32).reshape(-1, POSE_SUMS).sum(axis=0, dtype=np.float64)
    turned, moved, looked = sums[:9].reshape(3, 3), sums[9:12], sums[12:]
    # p = R m + t, and the sums took m from the centre
    turned = turned + np.outer(moved, np.linalg.solve(rotation, -shift))
    # the camera's centre -R^T t, of which every direction is the negative
    turned = turned + np.outer(shift, looked)
    moved = moved + rotation @ looked
    return torch.from_numpy(np.concatenate([turned, moved[:, None]], axis=1))


def render_gpu(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, pose: Tensor | None, settings: RasterSettings
) -> Rendered:
    """See `core.rasterizer.render`; float32 tensors on the device 'gpu'.

    Raises:
        DeviceError: the tensors are not float32 on the card, or there is no card.
    """
    register()
    if gaussians.means.dtype != torch.float32:
        raise DeviceError("The gpu rasterizer takes float32 tensors", "Use the back end 'reference' for float64")
    if not isinstance(gaussians.means, CardTensor):
        raise DeviceError("The gpu back end was given Gaussians in the computer's memory", "Move them to 'gpu' first")
    screen = ScreenStatistics(radius=torch.zeros(0))
    behind = torch.zeros(3) if background is None else background
    parameters = [tensor for _, tensor in gaussians.named()]
    inputs = (*parameters, behind, pose)
    learns = torch.is_grad_enabled() and any(tensor is not None and tensor.requires_grad for tensor in inputs)
    image, alpha, depth = _Rasterize.apply(camera, settings, screen, *inputs, learns)  # type: ignore[no-untyped-call]
    return Rendered(image, alpha, depth if settings.depth else None, screen)
