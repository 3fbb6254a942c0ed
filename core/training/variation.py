"""Total variation of the sharp render, over the three colours together (Blomgren and Chan 1998).

It discourages detail that no photo asks for: what the blur removed beyond recovery would otherwise
fill with speckle. Joint over colours, so that edges of different channels stay at one place and
no coloured fringes arise.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..compiled import run

#: Differences below about this size (in [0, 1]) are treated as quadratic: one 8-bit step.
SMOOTH = 1.0 / 255.0


def variation_gradient(image: Tensor) -> Tensor:
    """Gradient of sum sqrt(|dx|^2 + |dy|^2 + eps^2) (summed over colours inside the root).

    Args:
        image: [3, H, W] float32.

    Pixels of the last row have no difference downwards; those of the last column have none at all.

    Returns:
        [3, H, W]; each value lies in [-4, 4].
    """
    if not image.is_cuda:
        from .variation_kernels import edge_directions, negative_divergence

        source = image.detach().contiguous().numpy()
        horizontal, vertical, out = (np.empty_like(source) for _ in range(3))
        run(edge_directions, source.shape[1], source, np.float32(SMOOTH**2), horizontal, vertical, grain=16)
        run(negative_divergence, source.shape[0] * source.shape[1], horizontal, vertical, out, grain=48)
        return torch.from_numpy(out)
    leaf = image.detach().requires_grad_()
    with torch.enable_grad():
        right = leaf[:, :, 1:] - leaf[:, :, :-1]
        down = torch.nn.functional.pad(leaf[:, 1:, :-1] - leaf[:, :-1, :-1], (0, 0, 0, 1))
        total = (right.square().sum(0) + down.square().sum(0) + SMOOTH**2).sqrt().sum()
        (gradient,) = torch.autograd.grad(total, leaf)
    return gradient
