"""Gaussians and a camera in, an image out, and its gradient: the shaders as a torch autograd function.

Forward: projection, a radix sort by depth, a list of splats for each tile (a second sort), blending, which leaves
checkpoints along the lists where a backward pass may come. Backward: a gradient slot for each pair of a splat and a
tile, all chunks of the lists side by side, then each Gaussian's slots in their order, chained to the parameters. No
two threads add to one number, so the same input gives the same bits, with or without float atomics.

Frames along a camera's path go through all of it together: each has splats, tiles and lists of its own, one frame's
behind the other's, so that one row of orders and one wait serve them all.
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
from ...rendering import RasterSettings, Rendered, RenderedPath, ScreenStatistics
from .card import Card, Memory, card
from .layout import CHECKPOINT, CHUNK, GROUP, LONG_LISTS, POSE_SUMS, REASONS, SLOT_WIDTH
from .operands import unused
from .sorting import prefix_sums, sort
from .tensors import CardTensor, empty, for_shader, from_host, register, written

#: Bytes of a projected Gaussian (`splat.wgsl`).
_SPLAT = 64
#: Where the view says to the backward pass of which outputs gradients came, in bytes (`view.wgsl`).
_CAME = 4 * (8 * 4 + 3)
#: Where the view says to `find_surface` how much light passes, in bytes.
_LEVEL = 4 * (10 * 4 + 1)
#: Bytes of a chunk's entry (`chunks.wgsl`).
_CHUNK = 16


@dataclass
class Projected:
    """What the forward pass leaves on the card for the backward pass.

    Attributes:
        view: the shaders' uniform; tiles: across and down, of all frames; count: of Gaussians; harmonics: of each.
        poses: where the camera stands in each of several frames.
        ranges: each tile's part of `lists`; slots: each Gaussian's range of gradient slots in each frame.
        pairs: of a splat and a tile.
        chunks: the parts of `lists` that groups of the backward pass take; room: for so many, most of them used.
        checkpoints: what pixels held where a chunk begins; empty, as `chunks`, where no backward pass can come.
    """

    view: bytes
    tiles: tuple[int, int]
    count: int
    harmonics: int
    parameters: tuple[Memory, ...]
    poses: Memory
    splats: Memory
    lists: Memory
    ranges: Memory
    slots: Memory
    pairs: int
    room: int
    chunks: Memory
    checkpoints: Memory


def standpoint(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> NDArray[np.float32]:
    """[4, 4] a pose, world to camera, as `view.wgsl` and `standpoints.wgsl` lay it out."""
    centre = np.linalg.solve(rotation, -translation)
    near = centre.astype(np.float32)
    numbers = np.zeros((4, 4), np.float32)
    numbers[:3, :3], numbers[:3, 3] = rotation, near
    numbers[3, :3] = centre - near
    return numbers


def view_numbers(
    camera: Camera,
    pose: NDArray[np.float64] | None,
    settings: RasterSettings,
    background: NDArray[np.float32],
    shape: tuple[int, int],
    learns: bool,
    frames: int = 1,
) -> bytes:
    """Camera and settings as `view.wgsl` lays them out.

    Args:
        pose: [3, 4] world to camera, of the first frame; the camera's own if None.
        shape: Gaussians, harmonics of each.
        learns: whether a backward pass may come.
        frames: along a path.
    """
    width, height = camera.width, camera.height
    numbers = np.zeros((11, 4), np.float32)
    numbers[:4] = standpoint(*((camera.rotation, camera.translation) if pose is None else (pose[:, :3], pose[:, 3])))
    numbers[4] = camera.fx, camera.fy, camera.cx, camera.cy
    for column, (focal, middle, size) in enumerate(((camera.fx, camera.cx, width), (camera.fy, camera.cy, height))):
        beside = FRUSTUM_MARGIN * size
        numbers[5, 2 * column : 2 * column + 2] = -(middle + beside) / focal, (size - middle + beside) / focal
    numbers[6] = width, height, settings.near, settings.low_pass
    numbers[7] = settings.alpha_minimum, settings.alpha_minimum or SMOOTH_ALPHA_EDGE, settings.antialias, learns
    numbers[8, :3] = background
    numbers[9].view(np.uint32)[:] = *shape, -(-width // TILE), -(-height // TILE)
    numbers[10].view(np.uint32)[0] = frames
    return numbers.tobytes()


def project(
    device: Card,
    view: bytes,
    parameters: tuple[Memory, ...],
    shape: tuple[int, int],
    radius: Memory,
    poses: Memory | None = None,
) -> tuple[Projected, list[int]]:
    """Projection, depth order and the tiles' lists; and how many Gaussians of all frames have which status.

    Args:
        poses: `standpoint` of each of several frames.
    """
    across, down, frames = (int(n) for n in np.frombuffer(view, np.uint32)[38:41])
    learns = bool(np.frombuffer(view, np.float32)[31])
    count, tiles_in_all = shape[0] * frames, across * down * frames
    poses = unused() if poses is None else poses
    splats, reasons = device.memory(_SPLAT * count), device.memory(4 * REASONS)
    keys, tile_counts, order = (device.memory(4 * count) for _ in range(3))
    places = device.memory(4 * (count + 1))
    device.clear(reasons)
    written_there = splats, keys, tile_counts, radius, reasons
    device.for_each("project", shape[0], GROUP, view, *parameters, *written_there, poses)
    known = device.fetch(reasons, 4 * REASONS)  # (the card sorts while its numbers come)
    keys, indices = sort(device, keys, None, count, 32)
    number = np.uint32(count).tobytes()
    device.for_each("ties", count, GROUP, number, keys, indices, splats, tile_counts, order, places)
    prefix_sums(device, places, count)
    totals = known().view(np.uint32).tolist()
    pairs = totals[-1]

    slots, ranges = device.memory(8 * count), device.memory(8 * (tiles_in_all + 1))
    tiles, owners = (device.memory(4 * pairs) for _ in range(2))
    lists = device.memory(8 * pairs)
    device.for_each("emit", count, GROUP, view, splats, order, places, tiles, owners, slots)
    tiles, numbers = sort(device, tiles, None, pairs, tiles_in_all.bit_length())
    # (each tile has part of a chunk at most, besides whole ones)
    room = pairs // CHUNK + tiles_in_all if learns else 0
    chunks = device.memory(_CHUNK * room)
    checkpoints = device.memory(4 * CHECKPOINT * TILE * TILE * (pairs // CHUNK) if learns else 0)
    device.clear(ranges)
    device.clear(chunks)
    device.for_each("tile_lists", pairs, GROUP, np.uint32(pairs).tobytes(), tiles, numbers, owners, lists, ranges)
    projected = Projected(
        view,
        (across, down * frames),
        *shape,
        parameters,
        poses,
        splats,
        lists,
        ranges,
        slots,
        pairs,
        room,
        chunks,
        checkpoints,
    )
    return projected, totals[:-1]


def blend(device: Card, p: Projected, outputs: tuple[CardTensor, ...]) -> None:
    """Writes image [3, H, W], transmittance, depth and alpha [H, W], and `p.chunks` and `p.checkpoints`.

    Each [K, ...] of K frames.
    """
    memories = [output.held.for_card(overwrite=True) for output in outputs]
    device.run("blend", p.tiles, p.view, p.splats, p.lists, p.ranges, p.chunks, p.checkpoints, *memories)
    if p.pairs > LONG_LISTS:  # (the card has nothing to do yet)
        device.send()
    for output in outputs:
        written(output)


@dataclass
class _Drawn:
    """What was blended: the images [3, H, W] or [K, 3, H, W], and transmittance, depth and alpha beside them."""

    projected: Projected
    image: CardTensor
    transmittance: CardTensor
    depth: CardTensor
    alpha: CardTensor


def _drawn(
    view: bytes,
    tensors: tuple[Tensor, ...],
    size: tuple[int, ...],
    screen: ScreenStatistics,
    poses: Memory | None = None,
) -> _Drawn:
    """Draws Gaussians, given by their five parameters; `size`: of the result, [K,] H, W."""
    device, parameters = card(), tuple(for_shader(t) for t in tensors)
    means, sh = tensors[0], tensors[4]
    radius, shape = empty(len(means)), (len(means), int(sh.shape[1]))
    projected, numbers = project(device, view, parameters, shape, radius.held.for_card(overwrite=True), poses)
    screen.radius = written(radius)
    screen.culled = {reason: n for reason, n in zip(CULL_REASONS[1:], numbers[1:], strict=False) if n}
    screen.evaluations = projected.pairs * TILE * TILE
    image, transmittance, depth, alpha = empty(*size[:-2], 3, *size[-2:]), empty(*size), empty(*size), empty(*size)
    blend(device, projected, (image, transmittance, depth, alpha))
    return _Drawn(projected, image, transmittance, depth, alpha)


def _gradients(drawn: _Drawn, *came: Tensor | None) -> tuple[list[CardTensor], Memory, int]:
    """Gradients in the five parameters and in the projected centres [N, 2]; sums for the pose, and their bytes.

    Args:
        came: gradients in image, alpha and depth.
    """
    p, device = drawn.projected, card()
    upstream = [None if g is None else for_shader(g) for g in came]
    view = bytearray(p.view)
    struct.pack_into("f", view, _CAME, sum(2**place for place, one in enumerate(upstream) if one is not None))
    slots = device.memory(4 * SLOT_WIDTH * p.pairs)
    seen = drawn.image, drawn.transmittance, drawn.depth
    known = [for_shader(tensor) for tensor in seen] + [unused() if one is None else one for one in upstream]
    of_lists = p.splats, p.lists, p.chunks, p.checkpoints
    device.for_each("blend_backward", p.room, 1, bytes(view), *of_lists, *known, slots)
    device.send()  # (the card works while what follows is written)
    widths = (3, 3, 4, 1, 3 * p.harmonics, 2)
    out = empty(p.count * sum(widths))
    sums = 4 * POSE_SUMS * -(-p.count // GROUP)
    of_pose = device.memory(sums)
    into = out.held.for_card(overwrite=True), of_pose
    device.for_each("project_backward", p.count, GROUP, p.view, *p.parameters, p.slots, slots, *into, p.poses)
    written(out)
    starts = np.cumsum((0, *widths)) * p.count
    shapes = ((-1, 3), (-1, 3), (-1, 4), (-1,), (-1, p.harmonics, 3), (-1, 2))
    # (views as torch makes them, but without asking it)
    parts = zip(starts[:-1], starts[1:], shapes, strict=True)
    return [CardTensor(out.local[a:b].reshape(shape), out.held) for a, b, shape in parts], of_pose, sums


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
        shape = (len(means), int(sh.shape[1]))
        where = None if pose is None else pose.detach().double().cpu().numpy()
        view = view_numbers(camera, where, settings, background.detach().float().cpu().numpy(), shape, learns)
        parameters = means, log_scales, quaternions, opacity_logits, sh
        drawn = _drawn(view, parameters, (camera.height, camera.width), screen)
        ctx.drawn, ctx.screen, ctx.camera, ctx.pose = drawn, screen, camera, where
        ctx.pose_like = None if pose is None else pose.detach()
        ctx.behind_like = background.detach()
        ctx.set_materialize_grads(False)
        # (tensors of their own: what `ctx` holds may not hold `ctx` in turn)
        image, alpha, depth = (CardTensor(t.local, t.held) for t in (drawn.image, drawn.alpha, drawn.depth))
        return image, alpha, depth

    @staticmethod
    def backward(ctx: Any, *came: Tensor | None) -> Any:
        found, of_pose, sums = _gradients(ctx.drawn, *came)
        ctx.screen.mean_gradient = found.pop()
        d_pose = d_background = None
        if ctx.pose_like is not None and ctx.needs_input_grad[9]:
            d_pose = _pose_gradient(ctx, card().read(of_pose, sums)).to(ctx.pose_like)
        if ctx.needs_input_grad[8]:
            in_image = torch.zeros_like(ctx.drawn.image) if came[0] is None else came[0]
            d_background = (in_image * ctx.drawn.transmittance).sum(dim=(1, 2)).to(ctx.behind_like)
        return (None, None, None, *found, d_background, d_pose, None)


class _RasterizePath(torch.autograd.Function):
    """means, log_scales, quaternions, opacity_logits, sh -> images [K, 3, H, W]."""

    @staticmethod
    def forward(
        ctx: Any,
        camera: Camera,
        poses: NDArray[np.float64],
        background: Tensor,
        settings: RasterSettings,
        screen: ScreenStatistics,
        learns: bool,
        *parameters: Tensor,
    ) -> Tensor:
        shape = (len(parameters[0]), int(parameters[4].shape[1]))
        behind = background.detach().float().cpu().numpy()
        view = view_numbers(camera, poses[0], settings, behind, shape, learns, len(poses))
        stands = torch.from_numpy(np.stack([standpoint(pose[:, :3], pose[:, 3]) for pose in poses]))
        size = (len(poses), camera.height, camera.width)
        ctx.drawn = _drawn(view, parameters, size, screen, for_shader(from_host(stands)))
        ctx.screen, image = screen, ctx.drawn.image
        return CardTensor(image.local, image.held)

    @staticmethod
    def backward(ctx: Any, d_images: Tensor) -> Any:  # type: ignore[override]
        found, _, _ = _gradients(ctx.drawn, d_images, None, None)
        ctx.screen.mean_gradient = found.pop()
        return (None, None, None, None, None, None, *found)


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
    parameters, behind, screen = _checked(gaussians), _behind(background), ScreenStatistics(radius=torch.zeros(0))
    inputs = (*parameters, behind, pose)
    learns = torch.is_grad_enabled() and any(tensor is not None and tensor.requires_grad for tensor in inputs)
    image, alpha, depth = _Rasterize.apply(camera, settings, screen, *inputs, learns)  # type: ignore[no-untyped-call]
    return Rendered(image, alpha, depth if settings.depth else None, screen)


def render_path_gpu(
    gaussians: Gaussians, camera: Camera, background: Tensor | None, poses: Tensor, settings: RasterSettings
) -> RenderedPath:
    """See `core.rasterizer.render_path`; all frames together, each projected and sorted from its own pose.

    Raises:
        DeviceError: as `render_gpu`.
    """
    parameters, behind, screen = _checked(gaussians), _behind(background), ScreenStatistics(radius=torch.zeros(0))
    learns = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in parameters)
    where = poses.detach().double().cpu().numpy()
    images = _RasterizePath.apply(camera, where, behind, settings, screen, learns, *parameters)  # type: ignore[no-untyped-call]
    return RenderedPath(images, (screen,))


def surface_gpu(gaussians: Gaussians, camera: Camera, settings: RasterSettings, held: float) -> Tensor:
    """See `core.devices.Backend.surface_of_centres`.

    Raises:
        DeviceError: as `render_gpu`.
    """
    means, *others = _checked(gaussians)
    shape, device = (len(means), int(others[-1].shape[1])), card()
    view = bytearray(view_numbers(camera, None, settings, np.zeros(3, np.float32), shape, learns=False))
    parameters = tuple(for_shader(tensor) for tensor in (means, *others))
    p, _ = project(device, bytes(view), parameters, shape, device.memory(4 * len(means)))
    struct.pack_into("f", view, _LEVEL, 1.0 - held)
    found = empty(camera.height, camera.width)
    into = found.held.for_card(overwrite=True)
    device.run("find_surface", p.tiles, bytes(view), p.splats, p.lists, p.ranges, into)
    return written(found)


def _behind(background: Tensor | None) -> Tensor:
    return torch.zeros(3) if background is None else background


def _checked(gaussians: Gaussians) -> list[Tensor]:
    """The five parameters, where they are the card's."""
    register()
    if gaussians.means.dtype != torch.float32:
        raise DeviceError("The gpu rasterizer takes float32 tensors", "Use the back end 'reference' for float64")
    if not isinstance(gaussians.means, CardTensor):
        raise DeviceError("The gpu back end was given Gaussians in the computer's memory", "Move them to 'gpu' first")
    return [tensor for _, tensor in gaussians.named()]
