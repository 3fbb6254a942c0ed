"""A rendered frame as photos see it through a medium, at any size of the picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ..compositing import transparent
from ..errors import PsfError
from ..forward import FixedMedium, medium_of, shared_medium
from ..frames import Frame
from ..imaging.psf import PointSpread
from ..imaging.psf_text import parse_psf
from .messages import Blur

#: Sizes that differ by less than this share are one: Blender's lenses have 32 bits.
_ROUNDING = 1e-4
#: Px that a point spread may reach at most: a picture much larger than the photos would take minutes.
_FARTHEST = 2048


def point_spread(blur: Blur) -> PointSpread | None:
    """The blur's point spread in px of the picture; None where it leaves every picture as it is.

    Raises:
        PsfError: its text makes no sense, its file cannot be read, or it is larger than any picture.
    """
    psf = parse_psf(blur.psf)
    if psf is None or psf.is_identity:
        return None
    step = blur.step
    if abs(step - 1.0) > _ROUNDING:
        if psf.samples is None:
            psf = replace(psf, sigma_x=psf.sigma_x / step, sigma_y=psf.sigma_y / step)
        else:
            psf = replace(psf, samples=psf.kernel(step) if step > 1.0 else _finer(psf.samples, step))
    if max(psf.radius) > _FARTHEST:
        raise PsfError(f"The medium blurs {max(psf.radius)} px of this picture", "Show a smaller one")
    return psf


def _finer(samples: np.ndarray, step: float) -> np.ndarray:
    """A kernel on a grid whose px are `step` < 1 times as wide, straight between its samples."""
    for _ in range(2):
        radius = samples.shape[0] // 2
        reach = math.ceil((radius + 1) / step) - 1
        at, there = np.arange(-reach, reach + 1) * step, np.arange(-radius - 1, radius + 2)
        padded = np.pad(samples, ((1, 1), (0, 0)))
        samples = np.stack([np.interp(at, there, column) for column in padded.T])  # (transposed: the other axis next)
    return samples / samples.sum()


def through(
    psf: PointSpread, blur: Blur, image: Tensor, alpha: Tensor, over_nothing: bool, reach: int
) -> tuple[Tensor, Tensor]:
    """What the medium makes of a frame.

    Args:
        image: [3, H + 2r, W + 2r] sRGB, over the background, or over black where there is none.
        alpha: [H + 2r, W + 2r]; over_nothing: whether there is no background; reach: r.

    Returns:
        The same in [3, H, W] and [H, W]: over black, the image is multiplied by alpha.
    """
    height, width = (side - 2 * reach for side in alpha.shape)
    medium = _medium(psf, Frame(height, width, reach), blur, image.device)
    seen = medium.degraded(image)
    if not over_nothing:
        return seen, alpha[reach : reach + height, reach : reach + width].contiguous()
    white = medium.degraded(image + (1.0 - alpha))
    planes = transparent(seen.cpu().numpy(), white.cpu().numpy(), blur.space)
    return torch.from_numpy(planes[:3] * planes[3:]), torch.from_numpy(np.ascontiguousarray(planes[3]))


def _medium(psf: PointSpread, frame: Frame, blur: Blur, device: torch.device) -> FixedMedium:
    if device.type == "cpu":
        return shared_medium(psf, frame, blur.space)
    return medium_of(psf, frame, blur.space, device)
