"""The light of several frames collected on one sensor: their mean, with its gradient; without that of torch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..colour import decoding_derivative, encoding_derivative, linear_to_srgb, srgb_to_linear
from ..compiled import run
from ..frames import in_a_row
from ..imaging.medium import BlurSpace
from ..tone_curve import ToneCurve
from .collecting_kernels import STEPS, collect, distribute, file_as, steepen, straighten

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
    if curve:
        return _Filed(frames, weights, space, curve)
    if space == "srgb":
        return _Displayed(frames, weights)
    if all(frame.device.type == "cpu" and frame.dtype == torch.float32 for frame in frames):
        columns = isinstance(weights, Tensor) and weights.dim() == 3 and weights.shape[1] == 1
        return _Turned(frames, weights) if columns else CollectedLight(frames, weights)
    return _Light(frames, weights)


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
    """What a camera with a curve of its own files."""

    def __init__(
        self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor, space: BlurSpace, curve: ToneCurve
    ) -> None:
        self._frames, self._curve = in_a_row([frame.detach() for frame in frames]), curve
        self._plain = collected(list(_by_curve(straighten, curve, self._frames)), weights, space)
        self.shown = _by_curve(file_as, curve, self._plain.shown)

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        parts = in_a_row(self._plain.gradient(upstream / self._curve.slope(self.shown)))
        return list(_by_curve(steepen, self._curve, self._frames, parts))


def _by_curve(step: Callable[..., None], curve: ToneCurve, values: Tensor, gradients: Tensor | None = None) -> Tensor:
    """Values [..., h, w] taken through a camera's curve by a kernel, or gradients back through it."""
    if values.device.type != "cpu" or values.dtype != torch.float32:
        if gradients is not None:
            return gradients * curve.slope(values)
        return curve.undone(values) if step is straighten else curve.filed(values)
    source = values.contiguous().numpy()
    out = np.empty_like(source) if gradients is None else gradients.numpy()
    rows = out.reshape(-1, out.shape[-1])
    shape = np.float32(curve.toe), np.float32(curve.shoulder)
    run(step, len(rows), source.reshape(rows.shape), *shape, rows, grain=_GRAIN)
    return torch.from_numpy(out)


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

    Attributes:
        light, shown: [3, h, w] their mean in linear light, and that as display values.
    """

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor) -> None:
        self._frames = in_a_row([frame.detach() for frame in frames]).numpy()
        shape = self._frames.shape[1:]
        rows = np.asarray(weights, np.float32).reshape(len(frames), -1)
        # [K, 3 h]: of the rows of all channels.
        self._weights = np.ascontiguousarray(
            np.tile(np.broadcast_to(rows, (len(frames), shape[1])), (1, shape[0])), np.float32
        )
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


class _Turned:
    """The same by columns: of the photo as its sensor took it, before it was turned upright."""

    def __init__(self, frames: Sequence[Tensor], weights: Sequence[float] | Tensor) -> None:
        assert isinstance(weights, Tensor)
        self._taken = CollectedLight([frame.mT.contiguous() for frame in frames], weights.mT)
        self.shown = self._taken.shown.mT.contiguous()

    def gradient(self, upstream: Tensor) -> list[Tensor]:
        """The gradient in each frame, given that in `shown`."""
        return [part.mT.contiguous() for part in self._taken.gradient(upstream.mT)]
