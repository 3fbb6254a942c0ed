"""What the photos leave open about a twin: samples of its colours that explain them equally well.

Laplace's approximation: around the twin the photos say F = sum c^2 J' H' H J / s^2 (Fisher's information
through the blur, in units c of the prior, noise s), so that the colours are spread as (I + F)^-1. F couples all
Gaussians that share px, and the blur couples them further; its diagonal alone would call every splat of a
blurred set well determined, because nothing in it says that a neighbour can make up for a change. So
the spread is sampled (Matheron's rule, "pathwise conditioning", Wilson et al. 2021): a sample e of the
prior is corrected by what the photos say about it,

    x = e + d,   (I + F) d = c J' H' (n / s - c H J e / s^2),   n white,

solved by conjugate gradients. Cut short, it errs to the side of too much uncertainty: what no photo
shows keeps the prior's spread. The preconditioner is the row sums of F, which bound it (J and H
have no negative entries), so that no region overshoots where many splats overlap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .linear_model import LinearModel, Viewpoint


@dataclass(frozen=True)
class Posterior:
    """Samples of what is left open.

    Attributes:
        steps: [S, N, 3] in units of the prior.
        noise: standard deviation of a photo's px, sRGB, that was assumed.
        seen: [V, N] whether a photo says more of a Gaussian's colour than the prior does.
    """

    steps: Tensor
    noise: float
    seen: Tensor

    def determined(self) -> Tensor:
        """[N] how much of each Gaussian's colour the photos fix: 1 all, 0 no more than the prior."""
        spread = self.steps.square().mean(dim=(0, 2))
        return (1.0 - spread).clamp(0.0, 1.0)


def sample_posterior(
    linear: LinearModel,
    taken: Sequence[Viewpoint],
    noise: float,
    samples: int = 8,
    iterations: int = 10,
    seed: int = 0,
    on_sample: Callable[[int], None] = lambda done: None,
) -> Posterior:
    """Samples the spread that photos at `taken` leave.

    Args:
        noise: standard deviation of the photos' px against a perfect twin's, sRGB in [0, 1].
        samples: how many; a standard deviation from S of them is itself uncertain by (2 S)^-0.5.
        iterations: of the conjugate gradients.
        on_sample: called with the number of samples done.
    """
    generator = torch.Generator().manual_seed(seed)
    rows, seen = _row_sums(linear, taken, noise)
    diagonal = 1.0 + rows

    def information(step: Tensor) -> Tensor:
        total = torch.zeros_like(step)
        for viewpoint in taken:
            total += linear.adjoint([linear.apply(step, viewpoint)], viewpoint)[0]
        return total / noise**2

    steps = []
    for index in range(samples):
        prior = torch.randn((len(linear.gaussians), 3), generator=generator)
        right = torch.zeros_like(prior)
        for viewpoint in taken:
            change = linear.apply(prior, viewpoint)
            noisy = torch.randn(change.shape, generator=generator) * noise
            right += linear.adjoint([noisy - change], viewpoint)[0] / noise**2
        steps.append(prior + _solved(information, right, diagonal, iterations))
        on_sample(index + 1)
    return Posterior(torch.stack(steps), noise, seen)


def _row_sums(linear: LinearModel, taken: Sequence[Viewpoint], noise: float) -> tuple[Tensor, Tensor]:
    """Row sums [N, 3] of F, and whether photos see [V, N] which Gaussians."""
    ones = torch.ones((len(linear.gaussians), 3))
    rows, seen = torch.zeros_like(ones), []
    for viewpoint in taken:
        one = linear.adjoint([linear.apply(ones, viewpoint)], viewpoint)[0].clamp(min=0.0) / noise**2
        seen.append(one.mean(dim=1) > 1.0)
        rows += one
    return rows, torch.stack(seen) if seen else torch.zeros((0, len(ones)), dtype=torch.bool)


def _solved(information: Callable[[Tensor], Tensor], right: Tensor, diagonal: Tensor, iterations: int) -> Tensor:
    """(I + F) x = right by preconditioned conjugate gradients from zero."""
    x = torch.zeros_like(right)
    residual = right.clone()
    scaled = residual / diagonal
    direction = scaled.clone()
    product = (residual * scaled).sum()
    for _ in range(iterations):
        image = direction + information(direction)
        curvature = (direction * image).sum()
        if not float(curvature) > 0.0 or not float(product) > 0.0:
            break
        length = product / curvature
        x += length * direction
        residual -= length * image
        scaled = residual / diagonal
        following = (residual * scaled).sum()
        direction = scaled + (following / product) * direction
        product = following
    return x
