"""The light of several frames collected on one sensor: their mean in linear light, with its gradient."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..colour import srgb_to_linear
from ..compiled import run
from .collecting_kernels import STEPS, collect, distribute

#: Rows of all channels that are worth a call to a thread.
_GRAIN = 64


@lru_cache(maxsize=1)
def decoding_table() -> NDArray[np.float32]:
    """[STEPS + 2] linear light of the display values i / STEPS."""
    return np.asarray(srgb_to_linear(np.arange(STEPS + 2) / STEPS), np.float32)


class CollectedLight:
    """Frames [3, h, w] sRGB that one exposure collects, float32 on the CPU; without gradient.

    Attributes:
        light, shown: [3, h, w] their mean in linear light, and that as display values.
    """

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float]) -> None:
        self._frames = np.stack([frame.detach().numpy() for frame in frames])
        self._weights = np.asarray(weights, np.float32)
        shape = self._frames.shape[1:]
        light, shown = np.empty(shape, np.float32), np.empty(shape, np.float32)
        self._rows = shape[0] * shape[1]
        run(collect, self._rows, *self._flat(), self._of(light), self._of(shown), grain=_GRAIN)
        self.light, self.shown = torch.from_numpy(light), torch.from_numpy(shown)

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        """The gradient in each frame, given that in `shown`."""
        out = np.empty_like(self._frames)
        came = self._of(upstream.contiguous().numpy())
        mine = self._of(self.light.numpy()), self._of(self.shown.numpy())
        run(distribute, self._rows, came, *self._flat(), *mine, self._of(out), grain=_GRAIN)
        return list(torch.from_numpy(out))

    def _flat(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        return self._of(self._frames), self._weights, decoding_table()

    def _of(self, planes: NDArray[np.float32]) -> NDArray[np.float32]:
        """[..., 3 h, w]: rows of all channels."""
        return planes.reshape(*planes.shape[:-3], self._rows, planes.shape[-1])
