"""The light of several frames collected on one sensor: their mean, with its gradient; without that of torch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..colour import decoding_derivative, encoding_derivative, linear_to_srgb, srgb_to_linear
from ..compiled import run
from ..frames import in_a_row
from ..imaging.medium import BlurSpace
from ..tone_curve import ToneCurve
from .collecting_kernels import STEPS, collect, collect_filed, distribute, distribute_filed

#: No curve besides sRGB's.
SRGB = ToneCurve()

#: Rows of all channels that are worth a call to a thread.
_GRAIN = 64


@lru_cache(maxsize=1)
def decoding_table() -> NDArray[np.float32]:
    """[STEPS + 2] linear light of the display values i / STEPS."""
    return np.asarray(srgb_to_linear(np.arange(STEPS + 2) / STEPS), np.float32)


class Collected(Protocol):
    """Frames [3, h, w] sRGB that one exposure collects.

    Attributes:
        shown: [3, h, w] sRGB their mean.
    """

    shown: Tensor

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        """The gradient in each frame, given that in `shown`."""
        ...


def collected(
    frames: Sequence[Tensor], weights: Sequence[float] | Tensor, space: BlurSpace, curve: ToneCurve = SRGB
) -> Collected:
    """The mean of frames [3, h, w] sRGB, in linear light or of their display values; the very frame where it is one.

    Args:
        weights: shares of the photo's light, of sum 1: one for each frame, or [K, h, 1] for each of its rows, or
            [K, 1, w] for each of its columns.
        curve: the camera's own, on top of sRGB.
    """
    if len(frames) == 1:
        return _Single(frames[0])
    if space == "linear" and all(frame.device.type == "cpu" and frame.dtype == torch.float32 for frame in frames):
        columns = isinstance(weights, Tensor) and weights.dim() == 3 and weights.shape[1] == 1
        return _Turned(frames, weights, curve) if columns else CollectedLight(frames, weights, curve)
    if curve:
        return _Filed(frames, weights, space, curve)
    return _Displayed(frames, weights) if space == "srgb" else _Light(frames, weights)


class _Single:
    """One frame."""

    def __init__(self, frame: Tensor) -> None:
        self.shown = frame

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        return [upstream]


def _over_planes(weights: Sequence[float] | Tensor, like: Tensor) -> Sequence[float | Tensor]:
    """Weights that multiply a frame: numbers, or [h, 1] or [1, w] for each."""
    return list(weights.to(like)) if isinstance(weights, Tensor) else weights


class _Filed:
    """What a camera with a curve of its own files, on any device and of any type."""

    def __init__(
        self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor, space: BlurSpace, curve: ToneCurve
    ) -> None:
        self._frames, self._curve = in_a_row([frame.detach() for frame in frames]), curve
        self._plain = collected(list(curve.undone(self._frames)), weights, space)
        self.shown = curve.filed(self._plain.shown)

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        parts = in_a_row(self._plain.gradient(upstream / self._curve.slope(self.shown)))
        return list(parts * self._curve.slope(self._frames))


class _Displayed:
    """The mean of display values."""

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor) -> None:
        self._weights = _over_planes(weights, frames[0])
        self.shown = torch.stack([w * frame for w, frame in zip(self._weights, frames, strict=True)]).sum(dim=0)

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        return [weight * upstream for weight in self._weights]


class _Light:
    """The mean in linear light, on any device and of any type; all frames at once, as a card likes it."""

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor) -> None:
        self._frames = torch.stack(list(frames))
        # [K, 1, 1, 1], [K, 1, h, 1] or [K, 1, 1, w]
        shares = weights[:, None] if isinstance(weights, Tensor) else torch.tensor(weights)[:, None, None, None]
        self._weights = shares.to(self._frames)
        self._light = srgb_to_linear(self._frames)
        self.shown = linear_to_srgb((self._weights * self._light).sum(dim=0))

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        upstream = upstream * encoding_derivative(srgb_to_linear(self.shown), self.shown)
        return list(self._weights * upstream * decoding_derivative(self._frames, self._light))


class CollectedLight:
    """The mean in linear light of frames [3, h, w] sRGB, float32 on the CPU.

    Args:
        curve: the camera's own, on top of sRGB, by which frames and photo are filed.

    Attributes:
        light: [3, h, w] their mean; shown: the same as it is filed.
    """

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor, curve: ToneCurve = SRGB) -> None:
        self._frames = in_a_row([frame.detach() for frame in frames]).numpy()
        shape = self._frames.shape[1:]
        rows = np.asarray(weights, np.float32).reshape(len(frames), -1)
        # [K, 3 h]: of the rows of all channels.
        self._weights = np.ascontiguousarray(
            np.tile(np.broadcast_to(rows, (len(frames), shape[1])), (1, shape[0])), np.float32
        )
        self._curve = (np.float32(curve.toe), np.float32(curve.shoulder)) if curve else ()
        # Their mean in linear light, as sRGB, and, where the camera has a curve of its own, as it is filed.
        self._means = tuple(np.empty(shape, np.float32) for _ in range(3 if curve else 2))
        self._rows = shape[0] * shape[1]
        kernel = collect_filed if curve else collect
        run(kernel, self._rows, *self._flat(), *map(self._of, self._means), grain=_GRAIN)
        self.light, self.shown = torch.from_numpy(self._means[0]), torch.from_numpy(self._means[-1])

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        """The gradient in each frame, given that in `shown`."""
        out = np.empty_like(self._frames)
        came, means = self._of(upstream.contiguous().numpy()), map(self._of, self._means)
        kernel = distribute_filed if self._curve else distribute
        run(kernel, self._rows, came, *self._flat(), *means, self._of(out), grain=_GRAIN)
        return list(torch.from_numpy(out))

    def _flat(self) -> tuple[Any, ...]:
        return self._of(self._frames), self._weights, decoding_table(), *self._curve

    def _of(self, planes: NDArray[np.float32]) -> NDArray[np.float32]:
        """[..., 3 h, w]: rows of all channels."""
        return planes.reshape(*planes.shape[:-3], self._rows, planes.shape[-1])


class _Turned:
    """The same by columns: of the photo as its sensor took it, before it was turned upright."""

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor, curve: ToneCurve) -> None:
        assert isinstance(weights, Tensor)
        self._taken = CollectedLight([frame.mT.contiguous() for frame in frames], weights.mT, curve)
        self.shown = self._taken.shown.mT.contiguous()

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        """The gradient in each frame, given that in `shown`."""
        return [part.mT.contiguous() for part in self._taken.gradient(upstream.mT)]
