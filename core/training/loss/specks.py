"""A price for single specks: what differs from its surroundings in ALL directions at once.

A logarithmic price (`variation`) lets high edges stand, and so it lets high points stand, which a blur allows to
stand almost anywhere: they are where noise ends up. Edges and lines change across themselves only. The structure tensor

    J = b * sum over colours of grad x grad x',   b: the binomial mean over 3 x 3 px

separates them: of an edge its smaller eigenvalue l2 is zero, of a speck it is not (Foerstner and Guelch 1987;
as a prior: Lefkimmiatis et al. 2015). The price is sum sqrt(l2 + eps^2).
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...devices import backend_on
from .variation import SMOOTH

#: A binomial filter of three px: the smallest smooth mean.
_BINOMIAL = (0.25, 0.5, 0.25)


def speck_gradient(image: Tensor) -> Tensor:
    """Gradient of sum sqrt(l2 + eps^2), l2 the smaller eigenvalue of the structure tensor of all colours.

    Args:
        image: [3, H, W] float32.

    Pixels of the last row and column have no differences.

    Returns:
        [3, H, W].
    """
    return backend_on(image.device).speck_gradient(image)


def speck_gradient_in_torch(image: Tensor) -> Tensor:
    """The same in plain torch, on any device."""
    leaf = image.detach().requires_grad_()
    with torch.enable_grad():
        (gradient,) = torch.autograd.grad(speck_price(leaf), leaf)
    return gradient


def speck_price(image: Tensor) -> Tensor:
    """The price itself; the specification of the compiled gradient. `image`: [3, H, W] of any float type."""
    right = image[:, :-1, 1:] - image[:, :-1, :-1]
    down = image[:, 1:, :-1] - image[:, :-1, :-1]
    fields = torch.stack([right.square().sum(0), down.square().sum(0), (right * down).sum(0)])
    taps = torch.tensor(_BINOMIAL, dtype=image.dtype, device=image.device)
    binomial = torch.outer(taps, taps)[None, None]
    a, b, c = torch.nn.functional.conv2d(torch.nn.functional.pad(fields, (1, 2, 1, 2))[:, None], binomial)[:, 0]
    spread = (((a - b) / 2).square() + c.square() + SMOOTH**4).sqrt()
    low = ((a + b) / 2 - spread).clamp(min=0.0)
    return (low + SMOOTH**2).sqrt().sum()
