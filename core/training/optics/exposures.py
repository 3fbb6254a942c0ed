"""Exposure of every photo, learned with the Gaussians: a gain and an offset for each channel, in linear light.

The Gaussians are fitted to photos with their exposure undone, and the exposures to what the Gaussians show: every time
a photo is visited, its gains g (natural log) and offsets o take a part of a Gauss-Newton step on

    F(g, o) = n mean rho((y - c(exp(g) L + o)) / k) + (g / s_g)^2 / 2 + (o / s_o)^2 / 2,   rho(u) = sqrt(1 + u^2) - 1

with L the linear light that the twin shows through the medium, c the sRGB curve, y the photo as it was filed, and the
prior on 'no change' in the last two terms. Mean log gain and mean offset over the photos stay 0: what all share is the
scene's. A px at the upper end of the file says only that the light was at least that, one at the lower end at most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...colour import encoding_derivative, linear_to_srgb, srgb_to_linear
from ...devices import LevelCurve, backend_on, in_memory
from ...imaging.formation.exposure import Exposure
from ...numbers import number

Array = NDArray[np.float64]


#: Largest of the levels that a photo's px are rounded to where its exposure is undone: a sensor's 14 bits.
_LEVELS = 16383


#: What chose most of the numbers below, and what they were checked on.
_JUDGED = "judgement, before the first run; no other value was tried"
_CHECKED = "copr and brighton, real and with gains of 0.75 stops either way: docs/effects.md"
#: What chose what concerns photos without any picture.
_BLACK_AND_WHITE = "a drawn set of eight photos with a black and a white one"


@dataclass(frozen=True)
class LearnedExposureSettings:
    """Numbers of the exposures that are learned."""

    prior_gain: float = number(0.5, "natural log", "standard deviation of a photo's gain: 0.7 stops", _JUDGED, _CHECKED)
    prior_offset: float = number(
        0.003,
        "linear light",
        "standard deviation of a photo's offset: stray light and black levels differ little",
        _JUDGED,
        _CHECKED,
    )
    knee: float = number(0.05, "sRGB", "residuals beyond count as their size, not its square", _JUDGED, _CHECKED)
    independent: float = number(500.0, "px", "that a photo's px count as: neighbours err alike", _JUDGED, _CHECKED)
    share: float = number(0.3, "of a step", "that is taken at each visit: the twin changes, too", _JUDGED, _CHECKED)
    begin: float = number(
        0.05, "share of the run", "from which on exposures are learned: before, the twin is a fog", _JUDGED, _CHECKED
    )
    largest_step: float = number(1.0, "natural log", "that a gain changes at a visit at most", _BLACK_AND_WHITE)
    largest_gain: float = number(
        5.0, "natural log", "either way: seven stops; a black or white photo shows no gain", _BLACK_AND_WHITE
    )
    usual_gain: float = number(
        3.0,
        "prior standard deviations",
        "beyond which a photo's gain is no part of the mean over the photos",
        _BLACK_AND_WHITE,
    )
    white: float = number(0.985, "sRGB", "from which on a px may be clipped: 251 of 255, as photos are averaged")
    black: float = number(0.004, "sRGB", "up to which a px may be: 1 of 255")
    opaque: float = number(0.95, "share", "of a px that shows the object, from which on it says something of a gain")
    most_pixels: int = number(20_000, "px", "of a photo that are looked at in a visit, evenly over it")


SETTINGS = LearnedExposureSettings()


@dataclass(frozen=True)
class Asked:
    """What a photo asks of the twin: `photo` [3, H, W] sRGB without its exposure, and `weight` [3, 1, 1] of it."""

    photo: Tensor
    weight: Tensor


def reexposed_in_torch(photo: Tensor, shown: Tensor, curve: LevelCurve) -> Tensor:
    """See `core.devices.Backend.reexposed`: what every back end does, in plain torch.

    Curves are taken of levels, not of all px; they rise, so that what is clipped begins at one level.
    """
    white, black, most = (one.to(photo.device)[:, None, None] for one in (curve.white, curve.black, curve.most))
    at = (photo.clamp(0.0, 1.0) * (curve.table.shape[1] - 1)).round_().to(torch.int64)
    asked = torch.gather(curve.table.to(photo.device), 1, at.reshape(3, -1)).reshape(photo.shape)
    over, under = at >= white, at < black
    if bool(over.any()):
        asked[over] = torch.maximum(asked[over], shown[over])
    if bool(under.any()):
        asked[under] = torch.minimum(torch.maximum(asked[under], shown[under]), most.expand_as(asked)[under])
    return asked


@dataclass(frozen=True)
class Slope:
    """Of F in one photo's gains and offsets: `value`, `gradient` [3, 2], and Gauss-Newton's `curvature` [3, 2, 2]."""

    value: float
    gradient: Array
    curvature: Array


class LearnedExposures:
    """Exposures of the photos that are trained on.

    Args:
        start: what was undone on the photos beforehand, and where learning begins.

    Attributes:
        names: of the photos; values: [V, 3, 2] log gains and offsets.
    """

    def __init__(self, start: Exposure, settings: LearnedExposureSettings = SETTINGS) -> None:
        self.names, self.settings = start.names, settings
        gains, offsets = (start.parameters[name].detach().double().cpu().numpy() for name in ("log_gains", "offsets"))
        self._start: Array = np.stack([gains, offsets], axis=2)
        self.values: Array = self._start.copy()
        self._index = {name: i for i, name in enumerate(start.names)}

    def exposure(self) -> Exposure:
        """As it is now."""
        return Exposure(self.names, *(torch.from_numpy(self.values[..., i].astype(np.float32)) for i in (0, 1)))

    def asked(self, name: str, photo: Tensor, shown: Tensor) -> Asked | None:
        """The photo without its exposure, where it may be clipped no farther from the twin than that allows.

        Args:
            photo: [3, H, W] sRGB without the exposure that learning began with.
            shown: [3, H, W] sRGB that the twin shows through the medium.

        Returns:
            None for a photo that is not among those that are learned.
        """
        index = self._index.get(name)
        if index is None:
            return None
        levels = torch.arange(_LEVELS + 1, dtype=photo.dtype).expand(3, 1, -1) / _LEVELS
        filed, over, under = self._filed(index, levels)
        gain, offset = self._now(index, levels)
        most = linear_to_srgb(((_linear(self.settings.black) - offset) / gain).clamp(min=0.0))
        curve = LevelCurve(
            table=linear_to_srgb((filed - offset) / gain)[:, 0],
            white=(~over).sum(dim=2)[:, 0],
            black=under.sum(dim=2)[:, 0],
            most=most[:, 0, 0],
        )
        # A darker photo shows the same change of the scene by a smaller one of its own: the curve's power of the gain.
        weight = (gain.clamp(max=1.0) ** (1.0 / 2.4)).to(photo.device)
        return Asked(backend_on(photo.device).reexposed(photo, shown, curve), weight)

    def learn(self, name: str, photo: Tensor, shown: Tensor, counts: Tensor | None) -> None:
        """Takes a part of a step of one photo's gains and offsets; arguments as of `asked`.

        Args:
            counts: [H, W] bool, px that count; None for all.
        """
        index, s = self._index.get(name), self.settings
        if index is None:
            return
        every = max(1, math.ceil(math.sqrt(photo.shape[1] * photo.shape[2] / s.most_pixels)))
        thin = (slice(None), slice(every // 2, None, every), slice(every // 2, None, every))
        counts = None if counts is None else counts[thin[1:]].cpu()
        slope = self.slope(name, in_memory(photo[thin]).double(), in_memory(shown[thin]).double(), counts)
        step = -s.share * np.linalg.solve(slope.curvature, slope.gradient[..., None])[..., 0]
        step *= np.minimum(1.0, s.largest_step / np.maximum(np.abs(step[:, :1]), 1e-12))
        if not np.isfinite(step).all():
            return
        self.values[index] += step
        self.settle()

    def settle(self) -> None:
        """Mean log gain and mean offset 0 over the photos, gains within their bounds.

        Photos far beyond the prior (a lens cap, a flash) have no say in what the mean exposure is.
        """
        bound, usual = self.settings.largest_gain, self.settings.usual_gain * self.settings.prior_gain
        self.values[..., 0] = np.clip(self.values[..., 0], -bound, bound)
        asked = np.abs(self.values[..., 0]).max(axis=1) < usual
        self.values -= self.values[asked if asked.any() else slice(None)].mean(axis=0, keepdims=True)

    def slope(self, name: str, photo: Tensor, shown: Tensor, counts: Tensor | None = None) -> Slope:
        """F, its gradient, and Gauss-Newton's curvature at the values as they are."""
        index, s = self._index[name], self.settings
        filed, over, under = self._filed(index, photo)
        gain, offset = self._now(index, photo)
        gained = gain * srgb_to_linear(shown)
        light = gained + offset
        encoded = linear_to_srgb(light)
        rest = encoded - linear_to_srgb(filed)
        settled = (over & (rest > 0)) | (under & (rest < 0))
        if counts is not None:
            settled = settled | ~counts
        rest = torch.where(settled, 0.0, rest) / s.knee
        root = (1.0 + rest.square()).sqrt()
        px = float(rest[0].numel() if counts is None else max(1, int(counts.sum())))
        slope = torch.where(settled, 0.0, encoding_derivative(light, encoded) / s.knee)
        by_gain = slope * gained
        factor = s.independent / px
        pairs = torch.stack([by_gain, slope])  # [2, 3, H, W]
        gradient = factor * (pairs * (rest / root)).sum(dim=(2, 3)).T
        curvature = factor * torch.einsum("achw,bchw->cab", pairs / root, pairs)
        priors = np.array([s.prior_gain, s.prior_offset]) ** -2.0
        now = self.values[index]
        return Slope(
            factor * float((root - 1.0).sum()) + float((priors * now**2).sum()) / 2.0,
            gradient.cpu().numpy() + priors * now,
            np.asarray(curvature.cpu().numpy() + np.diag(priors), np.float64),
        )

    def state(self) -> dict[str, Array]:
        """What a checkpoint keeps."""
        return {"exposures": self.values.copy()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there, and of these photos."""
        values = arrays.get("exposures")
        if values is None or values.shape != self.values.shape or not np.isfinite(values).all():
            return False
        self.values = np.array(values, np.float64)
        return True

    def _now(self, index: int, like: Tensor) -> tuple[Tensor, Tensor]:
        """[3, 1, 1] gain and offset of one photo."""
        values = torch.from_numpy(self.values[index]).to(like)[:, :, None, None]
        return values[:, 0].exp(), values[:, 1]

    def _filed(self, index: int, photo: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """[3, H, W] linear light as it was filed, and where that may be clipped to white and to black."""
        start = torch.from_numpy(self._start[index]).to(photo)[:, :, None, None]
        gain, offset = start[:, 0].exp(), start[:, 1]
        filed = gain * srgb_to_linear(photo) + offset
        # Photos without their exposure end at 1, too, however bright that was filed.
        most = (gain * 0.9999 + offset).clamp(max=_linear(self.settings.white))
        return filed, filed >= most, filed <= _linear(self.settings.black)


def _linear(encoded: float) -> float:
    """Linear light of one sRGB value."""
    return float(srgb_to_linear(np.array(encoded)))
