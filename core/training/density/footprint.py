"""What the twin looks like in every other viewer.

While training, each projected Gaussian is widened by `low_pass` px^2, which keeps it from inventing
detail between the pixels of a blurred photo. Other viewers widen by 0.3 px^2 of their own screen.
The difference is moved into the Gaussians themselves: an isotropic variance in space, a pixel's
size at the Gaussian's distance, is added to all three axes. (Same idea as Mip-Splatting's 3D
filter, Yu et al. 2024; there it limits, here it hands over.)
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from ...camera import Camera
from ...constants import LOW_PASS_VARIANCE
from ...gaussians import Gaussians


def seen_in(means: torch.Tensor, camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
    """[N] depth of places [N, 3] before a camera, and [N] bool: which lie in its frame, hidden or not."""
    p = means @ torch.from_numpy(camera.rotation.T.copy()).to(means) + torch.from_numpy(camera.translation.copy()).to(
        means
    )
    z = p[:, 2]
    u = camera.fx * p[:, 0] / z + camera.cx
    v = camera.fy * p[:, 1] / z + camera.cy
    return z, (z > 0) & (u > 0) & (u < camera.width) & (v > 0) & (v < camera.height)


def pixel_sizes(gaussians: Gaussians, cameras: Sequence[Camera]) -> torch.Tensor:
    """[N] median size of a photo's pixel at each Gaussian, over the views that see it (world units)."""
    means = gaussians.means.detach().double().cpu()
    sizes = torch.full((len(cameras), len(means)), torch.nan, dtype=torch.float64)
    for row, camera in enumerate(cameras):
        z, seen = seen_in(means, camera)
        sizes[row] = torch.where(seen, z / (0.5 * (camera.fx + camera.fy)), torch.nan)
    median = sizes.nanmedian(dim=0).values
    seen_ones = median[median.isfinite()]
    everywhere = seen_ones.median() if len(seen_ones) else torch.tensor(0.0, dtype=torch.float64)
    return torch.where(median.isfinite(), median, everywhere)


def widened(gaussians: Gaussians, cameras: Sequence[Camera], low_pass: float) -> Gaussians:
    """Gaussians that look under the usual low-pass as these do under `low_pass` (photo px^2)."""
    out = gaussians.detached()
    extra = low_pass - LOW_PASS_VARIANCE
    if extra <= 0:
        return out
    variance = extra * pixel_sizes(gaussians, cameras).to(out.means.device) ** 2
    scales = torch.exp(2.0 * out.log_scales.double())
    out.log_scales = (0.5 * torch.log(scales + variance[:, None])).to(out.means.dtype)
    return out
