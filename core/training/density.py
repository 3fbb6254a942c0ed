"""Adaptive density control: Gaussians go where the image asks for them (Kerbl et al. 2023, section 5.2).

Transparent Gaussians are removed; those whose projected centre has the largest gradient are cloned
(small ones) or split in two (large ones), up to a budget.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from ..gaussians import Gaussians
from ..rasterizer import ScreenStatistics
from .optimizer import Adam

#: Below this opacity a Gaussian is invisible behind 8-bit steps and is removed.
TRANSPARENT = 0.01
#: A split Gaussian's halves are smaller by this factor (3DGS).
SPLIT_SHRINK = 1.6
#: Gaussians larger than this quantile of all sizes are split rather than cloned.
SPLIT_QUANTILE = 0.5
#: At most this share of the Gaussians is added at a time.
GROWTH = 0.3


class DensityControl:
    """Collects how hard each Gaussian is pulled, and acts on it now and then."""

    def __init__(self, count: int, device: torch.device) -> None:
        self.device = device
        self.gradients = torch.zeros(count, device=device)
        self.views = torch.zeros(count, device=device)
        self.counts = {"pruned": 0, "cloned": 0, "split": 0}

    def collect(self, screen: ScreenStatistics) -> None:
        """Adds one view's gradients of the projected centres."""
        assert screen.mean_gradient is not None
        self.gradients += screen.mean_gradient.norm(dim=1).to(self.gradients.device)
        self.views += (screen.radius > 0).to(self.views.device, self.views.dtype)

    def act(self, optimizer: Adam, target: int, random: np.random.Generator) -> None:
        """Prunes, then clones and splits up to `target` Gaussians."""
        g = optimizer.gaussians.detached()
        opacity = torch.sigmoid(g.opacity_logits)
        alive = opacity > TRANSPARENT
        if int(alive.sum()) == 0:  # everything faded: keep the most opaque half rather than nothing
            alive = opacity >= opacity.median()
        score = torch.where(self.views > 0, self.gradients / self.views.clamp(min=1), 0.0)
        score = torch.where(alive, score, -1.0)
        living = int(alive.sum())
        wanted = max(0, min(target - living, int(math.ceil(GROWTH * living)), int((score > 0).sum())))
        chosen = torch.topk(score, wanted).indices if wanted else torch.zeros(0, dtype=torch.long, device=self.device)
        size = g.log_scales.max(dim=1).values
        large = size[chosen] > torch.quantile(size[alive][:1_000_000], SPLIT_QUANTILE)
        keep_mask = alive.clone()
        keep_mask[chosen[large]] = False
        keep = torch.nonzero(keep_mask)[:, 0]
        clones = _copies(g, chosen[~large], 1.0, random)
        first, second = (_copies(g, chosen[large], SPLIT_SHRINK, random) for _ in range(2))
        new = Gaussians(
            **{
                name: torch.cat([tensor, getattr(first, name), getattr(second, name)])
                for name, tensor in clones.named()
            }
        )
        optimizer.keep_and_append(keep, new)
        self.counts["pruned"] += len(g) - living
        self.counts["cloned"] += int((~large).sum())
        self.counts["split"] += int(large.sum())
        count = len(optimizer.gaussians)
        self.gradients, self.views = (torch.zeros(count, device=self.device) for _ in range(2))


def _copies(g: Gaussians, rows: Tensor, shrink: float, random: np.random.Generator) -> Gaussians:
    """Copies of some Gaussians, each at a place drawn from the Gaussian itself."""
    scales = torch.exp(g.log_scales[rows])
    drawn = torch.from_numpy(random.standard_normal((len(rows), 3)).astype(np.float32)).to(scales.device) * scales
    q = torch.nn.functional.normalize(g.quaternions[rows], dim=1)
    w, v = q[:, :1], q[:, 1:]
    # rotate by the quaternion: v' = v + 2 w (u x v) + 2 u x (u x v)
    cross = torch.linalg.cross(v, drawn)
    moved = drawn + 2 * w * cross + 2 * torch.linalg.cross(v, cross)
    return Gaussians(
        means=g.means[rows] + moved,
        log_scales=g.log_scales[rows] - math.log(shrink),
        quaternions=g.quaternions[rows].clone(),
        opacity_logits=g.opacity_logits[rows].clone(),
        sh=g.sh[rows].clone(),
    )
