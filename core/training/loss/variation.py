"""Variation of the sharp render, over the three colours together (Blomgren and Chan 1998).

It discourages detail that no photo asks for: what the blur removed beyond recovery would otherwise
fill with speckle. Joint over colours, so that edges of different channels stay at one place and
no coloured fringes arise.

Total variation takes as much from the height of a strong edge as from a faint ripple. Here the price of a
difference g rises as its logarithm instead, k log(1 + g / k): below the knee k it is the total variation,
far above it an edge costs hardly more for being high, so that lines keep their contrast while the overshoot
beside them is flattened (as hyper-Laplacian priors do: Krishnan and Fergus 2009).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...devices import backend_on

#: Differences below about this size (in [0, 1]) are treated as quadratic: one 8-bit step.
SMOOTH = 1.0 / 255.0


def variation_gradient(image: Tensor, knee: float = math.inf) -> Tensor:
    """Gradient of sum k log(1 + g / k), g = sqrt(|dx|^2 + |dy|^2 + eps^2) (summed over colours inside the root).

    Args:
        image: [3, H, W] float32.
        knee: k > 0; infinite for the total variation, sum g.

    Pixels of the last row have no difference downwards; those of the last column have none at all.

    Returns:
        [3, H, W]; each value lies in [-4, 4].
    """
    return backend_on(image.device).variation_gradient(image, knee)


def variation_gradient_in_torch(image: Tensor, knee: float) -> Tensor:
    """The same in plain torch, on any device: the specification."""
    leaf = image.detach().requires_grad_()
    with torch.enable_grad():
        right = leaf[:, :, 1:] - leaf[:, :, :-1]
        down = torch.nn.functional.pad(leaf[:, 1:, :-1] - leaf[:, :-1, :-1], (0, 0, 0, 1))
        size = (right.square().sum(0) + down.square().sum(0) + SMOOTH**2).sqrt()
        total = (size if math.isinf(knee) else knee * torch.log1p(size / knee)).sum()
        (gradient,) = torch.autograd.grad(total, leaf)
    return gradient
