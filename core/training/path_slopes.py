"""How a photo that was taken along a path changes along the two axes of the picture, part by part of the path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..colour import decoding_derivative, encoding_derivative, srgb_to_linear
from ..devices import all_in_memory
from ..forward import Exposed
from ..frames import in_a_row
from ..tone_curve import ToneCurve

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


@dataclass(frozen=True)
class Linearised:
    """What a step of a path is taken from, a photo seen in K values of px and channels.

    Attributes:
        jacobian: [30, K]; rest: [K] what is left of the photo; weight: [K] of each.
        trust: what a weighted px counts as; matrix [30, 30], vector [30]: normal equations, the prior included.
    """

    jacobian: Tensor
    rest: Tensor
    weight: Tensor
    trust: float
    matrix: Tensor
    vector: Tensor


def slopes_along(exposed: Exposed, basis: Tensor, at: Sampled) -> Slopes:
    """Slopes of the photo by the shift of each part of the path.

    Args:
        basis: [M + 1, T] share of frame t in part m, or [M + 1, T, H + 2m, 1] in each row of it, or
            [M + 1, T, 1, W + 2m] in each column; the first is the photo.
    """
    degraded = at.of_planes(exposed.degraded)
    if exposed.together is not None:
        seen, *both = all_in_memory(degraded, *_differences(_parts_through_effects(exposed, basis), at))
        encode, difference = encoding_derivative(srgb_to_linear(seen), seen), dict(zip(AXES, both, strict=True))
        return lambda down, right: difference[down, right] * 0.5 * encode
    frames = photo_px(exposed, in_a_row([frame.passage.reached for frame in exposed.frames]))
    seen, own, *both = all_in_memory(degraded, at.of_planes(frames), *_differences(frames, at))
    encode, decode = _through_curve(exposed, seen, own)
    difference = dict(zip(AXES, both, strict=True))
    shares = basis
    if basis.dim() == 4:
        shares = sampled(exposed, basis, at)

    def of_frames(down: int, right: int) -> Tensor:
        return _parts(shares, difference[down, right] * decode * 0.5) * encode

    return of_frames


def change_by(exposed: Exposed, shares: Tensor, at: Sampled) -> Tensor:
    """[3, h, w] (sRGB) by which a photo changes with the frames' light.

    Args:
        shares: [T, H + 2m, 1] of each frame's light in each row, or [T, 1, W + 2m] in each column, which add up to
            none.
    """
    degraded = at.of_planes(exposed.degraded)
    if exposed.together is not None:
        basis = torch.stack([shares, shares])  # (the first stands for the photo)
        seen, part = all_in_memory(degraded, at.of_planes(_parts_through_effects(exposed, basis)[1]))
        return part * encoding_derivative(srgb_to_linear(seen), seen)
    # Where all rows are exposed at once the first and the last frame alone count.
    used = [k for k, share in enumerate(shares) if bool(share.any())]
    frames = torch.stack([at.of_planes(photo_px(exposed, exposed.frames[k].passage.reached)) for k in used])
    seen, own = all_in_memory(degraded, frames)
    curve = curve_of(exposed)
    light = _parts(sampled(exposed, shares[used][None], at), srgb_to_linear(curve.undone(own) if curve else own))[0]
    return light * _through_curve(exposed, seen, own)[0]


def curve_of(exposed: Exposed) -> ToneCurve:
    """The camera's own, by which it filed the photo."""
    motion = exposed.formation.motion
    return ToneCurve() if motion is None else motion.curve


def _through_curve(exposed: Exposed, seen: Tensor, own: Tensor) -> tuple[Tensor, Tensor]:
    """Derivatives of what the photo files, `seen`, by its light, and of the frames' light by their values, `own`."""
    curve = curve_of(exposed)
    if not curve:
        return encoding_derivative(srgb_to_linear(seen), seen), decoding_derivative(own, srgb_to_linear(own))
    there, here = (srgb_to_linear(curve.undone(values)) for values in (seen, own))
    encode = encoding_derivative(there, curve.undone(seen)) / curve.slope(seen)
    return encode, decoding_derivative(curve.undone(own), here) * curve.slope(own)


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
