"""How a photo that was taken along a path changes along the two axes of the picture, part by part of the path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from ...colour import decoding_derivative, encoding_derivative, srgb_to_linear
from ...devices import all_in_memory
from ...forward import Exposed
from ...frames import in_a_row
from ...tone_curve import ToneCurve

#: The picture's axes: down, and to the right.
AXES = (1, 0), (0, 1)
#: Slopes [M + 1, 3, h, w] of the photo (sRGB / px) along one of `AXES`.
Slopes = Callable[[int, int], Tensor]


@dataclass(frozen=True)
class Sampled:
    """Px of a photo that a step looks at: every so many, away from the border, where differences reach."""

    rows: slice
    columns: slice

    @staticmethod
    def of(height: int, width: int, most: int) -> Sampled:
        """At most about `most` of them."""
        every = max(1, round(math.sqrt(height * width / most)))
        return Sampled(slice(1 + every // 2, height - 1, every), slice(1 + every // 2, width - 1, every))

    def of_planes(self, planes: Tensor, down: int = 0, right: int = 0) -> Tensor:
        """[..., h, w] of planes [..., H, W], or the px so far below and to the right of them."""
        rows, columns = (
            slice(s.start + by, s.stop + by, s.step) for s, by in ((self.rows, down), (self.columns, right))
        )
        return planes[..., rows, columns]


class Filed:
    """Values as a camera filed them, and what follows from its curve; each is computed once."""

    def __init__(self, values: Tensor, curve: ToneCurve) -> None:
        self.values, self.curve = values, curve

    @cached_property
    def srgb(self) -> Tensor:
        """SRGB's own values."""
        return self.curve.undone(self.values) if self.curve else self.values

    @cached_property
    def light(self) -> Tensor:
        """Linear."""
        return srgb_to_linear(self.srgb)

    @cached_property
    def slope(self) -> Tensor:
        """Derivative of sRGB's own values by those that were filed."""
        return self.curve.slope(self.values)

    @cached_property
    def decoding(self) -> Tensor:
        """Derivative of the light by sRGB's own values."""
        return decoding_derivative(self.srgb, self.light)

    @property
    def decode(self) -> Tensor:
        """Derivative of the light by what was filed."""
        return self.decoding * self.slope if self.curve else self.decoding

    @property
    def encode(self) -> Tensor:
        """Derivative of what was filed by the light."""
        encode = encoding_derivative(self.light, self.srgb)
        return encode / self.slope if self.curve else encode


class Looked:
    """A photo along its path in the px that a step looks at.

    Args:
        exposed: what the twin shows in it; at: which px.
    """

    def __init__(self, exposed: Exposed, at: Sampled) -> None:
        self.exposed, self.at = exposed, at

    @cached_property
    def curve(self) -> ToneCurve:
        """The camera's own, by which it filed the photo."""
        motion = self.exposed.formation.motion
        return ToneCurve() if motion is None else motion.curve

    @cached_property
    def whole(self) -> Tensor:
        """[T, 3, H + 2m, W + 2m] the frames as they were filed, with their margin."""
        return in_a_row([frame.passage.reached for frame in self.exposed.frames])

    @property
    def frames(self) -> Tensor:
        """[T, 3, H, W] of the photo's px, all of them."""
        return photo_px(self.exposed, self.whole)

    @cached_property
    def _held(self) -> list[Tensor]:
        """The photo and its frames, from a card at once."""
        return all_in_memory(self.at.of_planes(self.exposed.degraded), self.at.of_planes(self.frames))

    @cached_property
    def seen(self) -> Filed:
        """[3, h, w] the photo."""
        return Filed(self._held[0].contiguous(), self.curve)

    @cached_property
    def own(self) -> Filed:
        """[T, 3, h, w] its frames."""
        return Filed(self._held[1].contiguous(), self.curve)

    def light(self, used: list[int]) -> Tensor:
        """[K, 3, h, w] linear, of some of its frames."""
        return Filed(self._held[1][used], self.curve).light

    def differences(self) -> dict[tuple[int, int], Tensor]:
        """[T, 3, h, w] along each of `AXES`, of the next px and the one before."""
        return dict(zip(AXES, all_in_memory(*_differences(self.frames, self.at)), strict=True))


def slopes_along(looked: Looked, basis: Tensor) -> Slopes:
    """Slopes of the photo by the shift of each part of the path.

    Args:
        basis: [M + 1, T] share of frame t in part m, or [M + 1, T, H + 2m, 1] in each row of it, or
            [M + 1, T, 1, W + 2m] in each column; the first is the photo.
    """
    exposed, at = looked.exposed, looked.at
    if exposed.together is not None:
        degraded = at.of_planes(exposed.degraded)
        seen, *both = all_in_memory(degraded, *_differences(_parts_through_effects(exposed, basis), at))
        encode, difference = encoding_derivative(srgb_to_linear(seen), seen), dict(zip(AXES, both, strict=True))
        return lambda down, right: difference[down, right] * 0.5 * encode
    encode, decode, difference = looked.seen.encode, looked.own.decode, looked.differences()
    shares = basis
    if basis.dim() == 4:
        shares = sampled(exposed, basis, at)

    def of_frames(down: int, right: int) -> Tensor:
        return _parts(shares, difference[down, right] * decode * 0.5) * encode

    return of_frames


def change_by(looked: Looked, shares: Tensor) -> Tensor:
    """[3, h, w] (sRGB) by which a photo changes with the frames' light.

    Args:
        shares: [T, H + 2m, 1] of each frame's light in each row, or [T, 1, W + 2m] in each column, which add up to
            none.
    """
    exposed, at = looked.exposed, looked.at
    if exposed.together is not None:
        basis = torch.stack([shares, shares])  # (the first stands for the photo)
        seen, part = all_in_memory(
            at.of_planes(exposed.degraded), at.of_planes(_parts_through_effects(exposed, basis)[1])
        )
        return part * encoding_derivative(srgb_to_linear(seen), seen)
    # Where all rows are exposed at once the first and the last frame alone count.
    used = [k for k, share in enumerate(shares) if bool(share.any())]
    return _parts(sampled(exposed, shares[used][None], at), looked.light(used))[0] * looked.seen.encode


def _differences(planes: Tensor, at: Sampled) -> list[Tensor]:
    """Along each axis, of the next px and the one before."""
    return [at.of_planes(planes, down, right) - at.of_planes(planes, -down, -right) for down, right in AXES]


def _parts(basis: Tensor, frames: Tensor) -> Tensor:
    """Parts of a path [M + 1, 3, h, w], given shares [M + 1, T], [..., h, 1] or [..., 1, w] of frames [T, 3, h, w]."""
    if basis.dim() == 2:
        return torch.einsum("mt,tchw->mchw", basis, frames)
    if basis.shape[-1] == 1:
        return torch.einsum("mth,tchw->mchw", basis[..., 0], frames)
    return torch.einsum("mtw,tchw->mchw", basis[..., 0, :], frames)


def _parts_through_effects(exposed: Exposed, basis: Tensor) -> Tensor:
    """[M + 1, 3, H, W] linear light of each part of the path behind the effects.

    Effects are linear in the light but for what they add themselves, which is in the photo once: a part is what it adds
    to the whole. Where the shutter rolls, the rows' shares move along with the picture here, which errs by the path's
    length over the photo's height.
    """
    assert exposed.together is not None
    passage = exposed.together.passage
    light = torch.stack([srgb_to_linear(frame.passage.frame) for frame in exposed.frames])
    parts = [passage.stages[-1]]
    for more in _parts(basis[1:].to(light), light):
        through = passage.stages[0] + more
        for effect in passage.effects:
            through = effect.forward(through, passage.shot)
        parts.append(through - passage.stages[-1])
    return photo_px(exposed, torch.stack(parts))


def photo_px(exposed: Exposed, planes: Tensor) -> Tensor:
    """The photo's own px [..., H, W] of planes with their margin."""
    m, shot = exposed.shot.margin, exposed.shot
    return planes[..., m : m + shot.height, m : m + shot.width]


def sampled(exposed: Exposed, shares: Tensor, at: Sampled) -> Tensor:
    """Shares [..., h, 1] or [..., 1, w] of the photo's own rows or columns that a step looks at."""
    m, shot = exposed.shot.margin, exposed.shot
    if shares.shape[-1] == 1:
        return shares[..., m : m + shot.height, :][..., at.rows, :]
    return shares[..., m : m + shot.width][..., at.columns]
