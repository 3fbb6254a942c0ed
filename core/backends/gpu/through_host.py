"""What the card has no shader for yet is done by the compiled kernels of the CPU, on copies."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from ...frames import Evaluation
from .tensors import DEVICE


@dataclass(frozen=True)
class ThroughHost:
    """A blur of the CPU for frames on the card; see `core.frames.Evaluation`."""

    inner: Evaluation

    @property
    def name(self) -> str:
        """The CPU's."""
        return self.inner.name

    def apply(self, frame: Tensor) -> Tensor:
        """See `Evaluation`."""
        return self.inner.apply(frame.cpu()).to(DEVICE)

    def adjoint(self, photo: Tensor) -> Tensor:
        """See `Evaluation`."""
        return self.inner.adjoint(photo.cpu()).to(DEVICE)
