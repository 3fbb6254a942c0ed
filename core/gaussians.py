"""The Gaussians of a twin as torch tensors, in the raw form that is optimized."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from .cloud import GaussianCloud
from .constants import SH_COEFFICIENTS


@dataclass
class Gaussians:
    """Gaussians as torch tensors; shapes and meaning as in `GaussianCloud`."""

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quaternions: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    sh: Tensor  # [N, K, 3]

    def __len__(self) -> int:
        return int(self.means.shape[0])

    @property
    def sh_degree(self) -> int:
        """Degree of the stored harmonics, 0 to 3."""
        return SH_COEFFICIENTS.index(int(self.sh.shape[1]))

    def named(self) -> Iterator[tuple[str, Tensor]]:
        """The five parameter tensors with their names, in a fixed order."""
        for item in fields(self):
            yield item.name, getattr(self, item.name)

    def to(self, *args: object, **options: object) -> Gaussians:
        """As `Tensor.to`, for all five tensors."""
        return Gaussians(**{name: tensor.to(*args, **options) for name, tensor in self.named()})  # type: ignore[call-overload]

    def detached(self) -> Gaussians:
        """A copy outside the autograd graph."""
        return Gaussians(**{name: tensor.detach().clone() for name, tensor in self.named()})

    def requires_grad_(self, on: bool = True) -> Gaussians:
        """Switches gradients of all parameters on or off, in place."""
        for _, tensor in self.named():
            tensor.requires_grad_(on)
        return self

    def cloud(self) -> GaussianCloud:
        """The same Gaussians as float32 numpy arrays."""
        return GaussianCloud(**{n: t.detach().cpu().numpy().astype(np.float32) for n, t in self.named()})

    @staticmethod
    def from_cloud(cloud: GaussianCloud, device: str = "cpu", dtype: torch.dtype = torch.float32) -> Gaussians:
        """Tensors that own a copy of the arrays of `cloud`."""
        return Gaussians(
            **{f.name: torch.tensor(getattr(cloud, f.name), dtype=dtype, device=device) for f in fields(cloud)}
        )
