"""The mathematics of a free kernel: what its weights mean on a grid, the convolution, and both gradients."""

from __future__ import annotations

import math

import torch
from scipy.fft import next_fast_len
from torch import Tensor


def sharp_weights(count: int, side: int) -> Tensor:
    """[count, 1 + side^2] of kernels that leave the light as it is."""
    weights = torch.zeros(count, 1 + side**2)
    weights[:, 0] = 1.0
    return weights


def places(side: int, like: Tensor) -> Tensor:
    """[side^2, 2] x and y of the tents, in distances between them, row by row from the upper left."""
    line = torch.arange(side, device=like.device, dtype=like.dtype) - side // 2
    return torch.cartesian_prod(line, line).flip(1)


def variances(weights: Tensor, side: int) -> Tensor:
    """[V] mean of both axes' variance of the kernels' weights [V, 1 + side^2], in squared distances between tents."""
    at = places(side, weights)
    tents = weights[:, 1:]
    total = weights.sum(dim=1, keepdim=True).clamp(min=1e-12)
    middle = tents @ at / total
    spread = (tents @ at.square() / total - middle.square()).sum(dim=1) / 2.0
    return spread.clamp(min=0.0)


def tents(side: int, pitch: float, like: Tensor) -> Tensor:
    """[K, side] each tent along one axis, on px around the middle; every column sums up to 1.

    Args:
        pitch: px between tents; below 1 px a tent is a px wide all the same, or it could miss every px.
    """
    half = max(pitch, 1.0)
    radius = math.ceil(side // 2 * pitch + half) - 1
    px = torch.arange(-radius, radius + 1, device=like.device, dtype=like.dtype)
    middle = (torch.arange(side, device=like.device, dtype=like.dtype) - side // 2) * pitch
    found = (1.0 - (px[:, None] - middle[None, :]).abs() / half).clamp(min=0.0)
    return found / found.sum(dim=0, keepdim=True)


def kernel_of(weights: Tensor, side: int, pitch: float) -> Tensor:
    """[K, K] kernel of weights [1 + side^2]; differentiable."""
    line = tents(side, pitch, weights)
    kernel = line @ weights[1:].reshape(side, side) @ line.T
    middle = torch.zeros_like(kernel)
    middle[len(line) // 2, len(line) // 2] = 1.0
    return kernel + weights[0] * middle


def _size(light: Tensor, kernel: Tensor) -> tuple[int, int]:
    rows, columns = light.shape[1] + kernel.shape[0], light.shape[2] + kernel.shape[1]
    return next_fast_len(rows, real=True), next_fast_len(columns, real=True)


def _transfer(kernel: Tensor, size: tuple[int, int]) -> Tensor:
    """[h, w // 2 + 1] of a kernel around its middle, on a periodic grid."""
    wide = torch.nn.functional.pad(kernel, (0, size[1] - kernel.shape[1], 0, size[0] - kernel.shape[0]))
    middle = kernel.shape[0] // 2
    return torch.fft.rfft2(torch.roll(wide, (-middle, -middle), (0, 1)))


def convolved(light: Tensor, kernel: Tensor) -> Tensor:
    """[3, h, w] light through a kernel [K, K], black beyond the frame; differentiable in both."""
    size = _size(light, kernel)
    spectrum = torch.fft.rfft2(light, s=size) * _transfer(kernel, size)
    return torch.fft.irfft2(spectrum, s=size)[:, : light.shape[1], : light.shape[2]].contiguous()


def gradients(upstream: Tensor, light: Tensor, kernel: Tensor, side: int, pitch: float) -> tuple[Tensor, Tensor]:
    """[3, h, w] and [1 + side^2]: of a loss in the light and in the weights, given that in `convolved`'s result."""
    size, radius = _size(light, kernel), kernel.shape[0] // 2
    of_upstream = torch.fft.rfft2(upstream, s=size)
    in_light = torch.fft.irfft2(of_upstream * _transfer(kernel, size).conj(), s=size)
    together = (of_upstream * torch.fft.rfft2(light, s=size).conj()).sum(dim=0)
    by_shift = torch.roll(torch.fft.irfft2(together, s=size), (radius, radius), (0, 1))
    in_kernel = by_shift[: kernel.shape[0], : kernel.shape[1]]
    line = tents(side, pitch, light)
    in_tents = (line.T @ in_kernel @ line).reshape(-1)
    in_weights = torch.cat([in_kernel[radius, radius][None], in_tents])
    return in_light[:, : light.shape[1], : light.shape[2]].contiguous(), in_weights


def seen_through_tents(light: Tensor, margin: int, side: int, pitch: float, every: int) -> Tensor:
    """[3, 1 + side^2, h, w] the light of every `every`th px as it is, and through each tent alone.

    Args:
        light: [3, H + 2m, W + 2m]; black beyond.
        margin: m; only the photo's own px are returned.
    """
    line = tents(side, pitch, light)
    radius = len(line) // 2
    rows, columns = light.shape[1] - 2 * margin, light.shape[2] - 2 * margin
    short = max(0, radius - margin)
    wide = torch.nn.functional.pad(light, (short,) * 4)
    cut = margin + short - radius + every // 2
    # A convolution turns the kernel around; `conv2d` does not.
    turned = line.flip(0).T.contiguous()
    across = wide[:, None, :, cut : cut + columns - every // 2 + 2 * radius]
    across = torch.nn.functional.conv2d(across, turned[:, None, None, :], stride=(1, every))
    down = across[:, :, cut : cut + rows - every // 2 + 2 * radius]
    planes = down.reshape(-1, 1, *down.shape[2:])
    both = torch.nn.functional.conv2d(planes, turned[:, None, :, None], stride=(every, 1))
    both = both.reshape(3, side, side, *both.shape[2:]).transpose(1, 2)  # [3, along y, along x, h, w]
    still = light[:, margin + every // 2 : margin + rows : every, margin + every // 2 : margin + columns : every]
    return torch.cat([still[:, None], both.reshape(3, side**2, *both.shape[3:])], dim=1)
