"""Adam for the five parameter tensors, with state that survives adding and removing Gaussians."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from ..compiled import run
from ..gaussians import Gaussians
from .adam_kernels import ROWS, RUN, adam_step

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-15


class Adam:
    """One step size per parameter; moments follow density control.

    Attributes:
        gaussians: the parameters; replaced by `keep_and_append`.
        first, second: moments by parameter name.
        refused: non-finite gradient entries that were not followed, by parameter name.
    """

    def __init__(self, gaussians: Gaussians) -> None:
        self.gaussians = gaussians.detached().requires_grad_()
        self.first = {name: torch.zeros_like(t) for name, t in gaussians.named()}
        self.second = {name: torch.zeros_like(t) for name, t in gaussians.named()}
        self.refused: dict[str, int] = {}
        self.steps = 0

    def step(self, rates: Mapping[str, float]) -> None:
        """One step along the gradients, then forgets them.

        Args:
            rates: a step size per parameter name, and 'sh_rest' for the harmonics of degree >= 1.
        """
        self.steps += 1
        bias1, bias2 = 1 - BETA1**self.steps, 1 - BETA2**self.steps
        for name, tensor in self.gaussians.named():
            gradient = tensor.grad
            tensor.grad = None
            if gradient is None:
                continue
            rate = rates[name] / bias1
            tail = rates["sh_rest"] / bias1 if name == "sh" else rate
            if tensor.is_cuda:
                self._step_torch(name, tensor, gradient, rate, tail, bias2**-0.5)
                continue
            period = max(1, tensor.numel() // max(1, tensor.shape[0]))
            blocks = -(-tensor.shape[0] // ROWS)
            refused = np.zeros(blocks, np.int64)
            flat = lambda t: t.detach().reshape(-1).numpy()  # noqa: E731
            rates_of_one = np.full(period, tail, np.float32)
            rates_of_one[: 3 if name == "sh" else period] = rate
            run(
                adam_step,
                blocks,
                flat(tensor),
                flat(gradient.contiguous()),
                flat(self.first[name]),
                flat(self.second[name]),
                np.tile(rates_of_one, RUN),
                period,
                np.float32(BETA1),
                np.float32(BETA2),
                np.float32(bias2**-0.5),
                np.float32(EPSILON),
                refused,
            )
            self._count(name, int(refused.sum()))

    def _step_torch(
        self, name: str, tensor: Tensor, gradient: Tensor, rate: float, tail: float, correction: float
    ) -> None:
        with torch.no_grad():
            finite = gradient.isfinite()
            self._count(name, int((~finite).sum()))
            gradient = torch.where(finite, gradient, 0)
            first, second = self.first[name], self.second[name]
            first.lerp_(gradient, 1 - BETA1)
            second.mul_(BETA2).addcmul_(gradient, gradient, value=1 - BETA2)
            move = first / second.sqrt().mul_(correction).add_(EPSILON)
            if name == "sh":
                tensor[:, :1] -= rate * move[:, :1]
                tensor[:, 1:] -= tail * move[:, 1:]
            else:
                tensor -= rate * move

    def _count(self, name: str, refused: int) -> None:
        if refused:
            self.refused[name] = self.refused.get(name, 0) + refused

    def keep_and_append(self, keep: Tensor, new: Gaussians) -> None:
        """Keeps the Gaussians at indices `keep` [K] and appends `new`, whose moments start at zero."""
        joined = {}
        for (name, old), (_, more) in zip(self.gaussians.named(), new.named(), strict=True):
            joined[name] = torch.cat([old.detach()[keep], more])
            for moments in (self.first, self.second):
                moments[name] = torch.cat([moments[name][keep], torch.zeros_like(more)])
        self.gaussians = Gaussians(**joined).requires_grad_()

    def forget(self, name: str, rows: Tensor) -> None:
        """Sets the moments of some Gaussians' parameter back to zero."""
        self.first[name][rows] = 0
        self.second[name][rows] = 0
