"""How far a degraded render is from its photo: (1 - w) mean |x - y| + w (1 - SSIM), with its gradient.

SSIM (Wang et al. 2004) uses an 11 x 11 Gaussian window of 1.5 px and the mean over all valid px, as
3D Gaussian splatting does; beyond the frame both images count as black. A photo px that is masked,
not finite or (if asked) saturated is grey in both, so that it adds no difference to any window
whatever stood there, is left out of both means, and has a gradient of exactly 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...compiled import run
from ...constants import TILE
from .photometric_kernels import BAND, C1, C2, REACH, photometric

#: Share of the SSIM term in the loss of 3D Gaussian splatting.
SSIM_WEIGHT = 0.2
#: What stands in photo and render where the photo does not count.
FILL = 0.5


def valid_pixels(photo: Tensor, mask: Tensor | None = None, saturation: float | None = None) -> Tensor:
    """[C, H, W] bool: which values of the photo count.

    Args:
        photo: [C, H, W] in [0, 1], or NaN where unknown.
        mask: [H, W] or [C, H, W], true (nonzero) where the photo counts.
        saturation: values at or above it say only that the scene was at least that bright, and
            are left out; None keeps them.
    """
    valid = torch.isfinite(photo)
    if saturation is not None:
        valid &= photo < saturation
    if mask is not None:
        valid = valid & (mask != 0)
    return valid


class PhotometricLoss:
    """The loss against one photo.

    Args:
        photo: [C, H, W] float32 on the CPU, sRGB in [0, 1]; NaN where unknown.
        mask: [H, W] or [C, H, W], nonzero where the photo counts; None for everywhere.
        ssim_weight: w in [0, 1].
        saturation: see `valid_pixels`.
    """

    def __init__(
        self,
        photo: Tensor,
        mask: Tensor | None = None,
        ssim_weight: float = SSIM_WEIGHT,
        saturation: float | None = None,
    ) -> None:
        if photo.ndim != 3 or not 0.0 <= ssim_weight <= 1.0:
            raise ValueError(f"photo is [C, H, W] and w in [0, 1], not {list(photo.shape)} and {ssim_weight}")
        self.ssim_weight, self.width = ssim_weight, photo.shape[2]
        photo = photo.detach().float()
        # A sum is finite only where every value is: nothing to sort out, in a single pass.
        if mask is None and saturation is None and bool(torch.isfinite(photo.sum())):
            self.count, self.valid = photo.numel(), None
        else:
            valid = valid_pixels(photo, mask, saturation)
            self.count, self.valid = int(valid.sum()), self._padded(valid.expand(photo.shape))
            photo = torch.where(valid, photo, FILL)
        self.photo = self._padded(photo)
        if self.valid is None:
            self.weights = (torch.arange(self.photo.shape[2]) < self.width).float()[None, None]
        else:
            self.weights = self.valid.float()

    def _padded(self, values: Tensor) -> Tensor:
        """With zeros on the right up to whole vectors."""
        lack = -self.width % TILE
        return torch.nn.functional.pad(values, (0, lack)) if lack else values.contiguous()

    def value_and_gradient(self, image: Tensor) -> tuple[float, Tensor]:
        """Loss, and its gradient [C, H, W] float32, of `image` [C, H, W] float32."""
        shape = *self.photo.shape[:2], self.width
        if image.shape != shape or image.dtype != torch.float32:
            raise ValueError(f"expected {list(shape)} float32, got {list(image.shape)} {image.dtype}")
        if self.count == 0:
            return 0.0, torch.zeros_like(image)
        w, x = self.ssim_weight, self._padded(image.detach())
        if self.valid is not None:
            x = torch.where(self.valid, x, self.photo)
        bands = max(1, round(shape[1] / BAND))
        sums, out = np.zeros((shape[0] * bands, 2)), torch.empty_like(self.photo)
        weights = np.float32((1 - w) / self.count), np.float32(w / self.count)
        arrays = (t.numpy() for t in (x, self.photo, self.weights))
        run(photometric, len(sums), bands, *arrays, *weights, out.numpy(), sums)
        structure, error = sums.sum(axis=0) / self.count
        value = (1 - w) * error + (w * (1 - structure) if w > 0 else 0.0)
        return float(value), out[:, :, : self.width].contiguous()

    def __call__(self, image: Tensor) -> Tensor:
        """The loss as a scalar tensor, differentiable in `image`."""
        value: Tensor = _Photometric.apply(image, self)
        return value


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, loss: PhotometricLoss) -> Tensor:
        value, gradient = loss.value_and_gradient(image)
        ctx.save_for_backward(gradient)
        return image.new_tensor(value)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None]:  # type: ignore[override]
        (gradient,) = ctx.saved_tensors
        # (nearly always 1, where a product would be one more image to write)
        return gradient if float(upstream) == 1.0 else upstream * gradient, None


def photometric_reference(
    image: Tensor,
    photo: Tensor,
    mask: Tensor | None = None,
    ssim_weight: float = SSIM_WEIGHT,
    saturation: float | None = None,
) -> Tensor:
    """The same loss in plain torch: the specification. Any float dtype and device; differentiable."""
    valid = valid_pixels(photo, mask, saturation)
    y = torch.where(valid, photo, FILL)
    x = torch.where(valid, image, y)
    count = valid.sum().clamp(min=1)
    error = torch.where(valid, (x - y).abs(), 0.0).sum() / count
    structure = torch.where(valid, structural_similarity_map(x, y), 0.0).sum() / count
    present = valid.any().to(x.dtype)
    return present * ((1 - ssim_weight) * error + ssim_weight * (1 - structure))


def structural_similarity_map(x: Tensor, y: Tensor) -> Tensor:
    """[C, H, W] SSIM around every px of two images [C, H, W], at most 1."""
    t = torch.arange(-REACH, REACH + 1, dtype=x.dtype, device=x.device)
    taps = torch.exp(-0.5 * (t / 1.5) ** 2)
    taps = taps / taps.sum()

    def window(v: Tensor) -> Tensor:
        down = torch.nn.functional.conv2d(v[:, None], taps[None, None, :, None], padding=(REACH, 0))
        return torch.nn.functional.conv2d(down, taps[None, None, None, :], padding=(0, REACH))[:, 0]

    mean_x, mean_y = window(x), window(y)
    variance_x = (window(x * x) - mean_x**2).clamp(min=0)
    variance_y = (window(y * y) - mean_y**2).clamp(min=0)
    covariance = torch.minimum(window(x * y) - mean_x * mean_y, 0.5 * (variance_x + variance_y))
    return (
        (2 * mean_x * mean_y + C1)
        * (2 * covariance + C2)
        / ((mean_x**2 + mean_y**2 + C1) * (variance_x + variance_y + C2))
    )
