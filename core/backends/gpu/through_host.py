"""What the card has no shader for, as frames in double precision, is done by the CPU's compiled kernels, on copies."""

from __future__ import annotations

from torch import Tensor

from ...frames import Evaluation
from .tensors import DEVICE


class ThroughHost:
    """A blur of the CPU for frames on the card; see `core.frames.Evaluation`."""

    def __init__(self, inner: Evaluation) -> None:
        self.name, self._inner = inner.name, inner

    def apply(self, frame: Tensor) -> Tensor:
        """See `Evaluation`."""
        return self._inner.apply(frame.cpu()).to(DEVICE)

    def adjoint(self, photo: Tensor) -> Tensor:
        """See `Evaluation`."""
        return self._inner.adjoint(photo.cpu()).to(DEVICE)
