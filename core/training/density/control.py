"""Adaptive density control: Gaussians go where the image asks for them (Kerbl et al. 2023, section 5.2).

Transparent Gaussians are removed; those whose projected centre has the largest gradient are cloned
(small ones) or split in two (large ones), up to a budget.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...devices import backend_on
from ...gaussians import Gaussians
from ...numbers import number
from ...rasterizer import ScreenStatistics
from ..optimizer import Adam

#: Sizes that a quantile is taken of: torch sorts no more than 16 million values, and a million says as much.
_QUANTILE_SAMPLE = 1_000_000


@dataclass(frozen=True)
class DensitySettings:
    """Numbers of the density control."""

    minimum_opacity: float = number(
        0.01, "opacity", "below it a Gaussian is next to invisible in 8-bit steps and is removed"
    )
    split_shrink: float = number(
        1.6,
        "factor",
        "by which the two halves of a split Gaussian are smaller",
        "3D Gaussian splatting (Kerbl et al. 2023)",
    )
    split_quantile: float = number(
        0.5, "quantile of sizes", "of all Gaussians; larger ones are split, smaller ones are cloned"
    )
    growth: float = number(
        0.3, "share of the Gaussians", "that is added at a time at most; more would crowd the first places that ask"
    )


DENSITY = DensitySettings()


class DensityControl:
    """Sums up each Gaussian's gradients on the screen, and acts on them now and then.

    Attributes:
        gradients: [N] lengths of the gradients in the projected centre; views: [N] how many views saw it.
        counts: 'pruned', 'cloned' and 'split' so far.
    """

    def __init__(self, count: int, device: torch.device) -> None:
        self.device = device
        self.gradients = torch.zeros(count, device=device)
        self.views = torch.zeros(count, device=device)
        self.counts = {"pruned": 0, "cloned": 0, "split": 0}

    def collect(self, screen: ScreenStatistics) -> None:
        """Adds one view's gradients of the projected centres."""
        assert screen.mean_gradient is not None
        backend_on(self.device).collect(screen.mean_gradient, screen.radius, self.gradients, self.views)

    def keep(self, optimizer: Adam, rows: Tensor) -> None:
        """Goes on with the Gaussians at indices `rows` [K], and with what is known of them."""
        optimizer.keep_and_append(rows, Gaussians(**{n: t[:0] for n, t in optimizer.gaussians.detached().named()}))
        self.gradients, self.views = self.gradients[rows], self.views[rows]

    def act(self, optimizer: Adam, target: int, random: np.random.Generator) -> None:
        """Prunes, then clones and splits up to `target` Gaussians."""
        g = optimizer.gaussians.detached()
        opacity = torch.sigmoid(g.opacity_logits)
        alive = opacity > DENSITY.minimum_opacity
        if int(alive.sum()) == 0:  # everything faded: keep the most opaque half rather than nothing
            alive = opacity >= opacity.median()
        score = torch.where(self.views > 0, self.gradients / self.views.clamp(min=1), 0.0)
        score = torch.where(alive, score, -1.0)
        living = int(alive.sum())
        wanted = max(0, min(target - living, int(math.ceil(DENSITY.growth * living)), int((score > 0).sum())))
        chosen = torch.topk(score, wanted).indices if wanted else torch.zeros(0, dtype=torch.long, device=self.device)
        size = g.log_scales.amax(dim=1)
        large = size[chosen] > torch.quantile(size[alive][:_QUANTILE_SAMPLE], DENSITY.split_quantile)
        keep_mask = alive.clone()
        keep_mask[chosen[large]] = False
        keep = torch.nonzero(keep_mask)[:, 0]
        clones = _copies(g, chosen[~large], 1.0, random)
        first, second = (_copies(g, chosen[large], DENSITY.split_shrink, random) for _ in range(2))
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
