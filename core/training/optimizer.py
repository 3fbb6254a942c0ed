"""Adam for the five parameter tensors, with state that survives adding and removing Gaussians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from ..devices import AdamStep, backend_on
from ..gaussians import Gaussians
from ..numbers import number


@dataclass(frozen=True)
class AdamSettings:
    """Numbers of Adam, besides its step sizes (`settings.Rates`)."""

    first_decay: float = number(0.9, "per step", "of the first moment", "Kingma and Ba 2015")
    second_decay: float = number(0.999, "per step", "of the second moment", "Kingma and Ba 2015")
    epsilon: float = number(
        1e-15,
        "gradient",
        "added to the denominator, which keeps it finite; small, as gradients of single px are",
        "3D Gaussian splatting (Kerbl et al. 2023)",
    )


ADAM = AdamSettings()


class Adam:
    """One step size per parameter; moments follow density control.

    Attributes:
        gaussians: the parameters; replaced by `keep_and_append`.
        first, second: moments by parameter name.
        steps: photos that were followed.
    """

    def __init__(self, gaussians: Gaussians) -> None:
        self.gaussians = gaussians.detached().requires_grad_()
        self.first = {name: torch.zeros_like(t) for name, t in gaussians.named()}
        self.second = {name: torch.zeros_like(t) for name, t in gaussians.named()}
        device = self.gaussians.means.device
        self._refused = {name: torch.zeros(1, dtype=torch.int32, device=device) for name, _ in gaussians.named()}
        self.steps = 0
        self._plain: dict[str, tuple[Tensor, Tensor]] = {}

    @property
    def refused(self) -> dict[str, int]:
        """Non-finite gradient entries that were not followed, by parameter name; without those that had none."""
        counts = {name: int(count) for name, count in self._refused.items()}
        return {name: count for name, count in counts.items() if count}

    @refused.setter
    def refused(self, counts: Mapping[str, int]) -> None:
        for name, count in self._refused.items():
            count.fill_(counts.get(name, 0))

    def step(self, rates: Mapping[str, float], photos: int = 1) -> None:
        """One step along the gradients, then forgets them.

        Args:
            rates: a step size per parameter name, and 'sh_rest' for the harmonics of degree >= 1.
            photos: that the gradients are the mean of. The step is as long as so many steps of single photos, and
                moments decay as often. (Zhao et al. 2024, "On Scaling Up 3D Gaussian Splatting Training", let rates
                grow with the root only; in runs as short as ours that is worse: docs/scale.md.)
        """
        self.steps += photos
        first_decay, second_decay = ADAM.first_decay**photos, ADAM.second_decay**photos
        bias1, bias2 = 1 - ADAM.first_decay**self.steps, 1 - ADAM.second_decay**self.steps
        steps = []
        for name, tensor in self.gaussians.named():
            gradient = tensor.grad
            tensor.grad = None
            if gradient is None:
                continue
            rate = photos * rates[name] / bias1
            tail = photos * rates["sh_rest"] / bias1 if name == "sh" else rate
            leading = 3 if name == "sh" else None
            moments, decays = (self.first[name], self.second[name]), (first_decay, second_decay)
            values, refused = self._values(name, tensor), self._refused[name]
            step = AdamStep(values, gradient, *moments, rate, tail, leading, bias2**-0.5, decays, ADAM.epsilon, refused)
            steps.append(step)
        if steps:
            backend_on(self.gaussians.means.device).adam(steps)

    def _values(self, name: str, tensor: Tensor) -> Tensor:
        """A parameter without its gradient, to be changed in place; made once, as a step makes five of them."""
        kept = self._plain.get(name)
        if kept is None or kept[0] is not tensor:
            kept = self._plain[name] = tensor, tensor.detach()
        return kept[1]

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
