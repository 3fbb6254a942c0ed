"""Exposure and white balance of every photo: a gain and an offset for each channel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from .effect import Effect, Shot, index_of

if TYPE_CHECKING:
    from torch import Tensor


class Exposure(Effect):
    """light -> exp(g) light + o, with g and o [V, 3] of V photos.

    A common factor of all photos cannot be distinguished from a brighter scene: mean gain 1 (mean g 0) and mean offset
    0 over the photos are the convention. Photos that are not named pass unchanged.
    """

    name = "exposure"
    physics = "Shutter, aperture, sensitivity and white balance multiply the light of each photo by factors of its own."
    place = "sensor"

    def __init__(self, names: Sequence[str], log_gains: Tensor, offsets: Tensor | None = None) -> None:
        zero = log_gains.new_zeros(log_gains.shape)
        super().__init__({"log_gains": log_gains, "offsets": zero if offsets is None else offsets})
        self.names = tuple(names)

    def _of(self, shot: Shot) -> tuple[int, Tensor, Tensor] | None:
        index = index_of(self.names, shot.name)
        if index is None:
            return None
        gain = self.parameters["log_gains"][index].exp()[:, None, None]
        return index, gain, self.parameters["offsets"][index][:, None, None]

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        found = self._of(shot)
        return light if found is None else found[1] * light + found[2]

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        found = self._of(shot)
        if found is None:
            return upstream
        index, gain, _ = found
        for name, value in (("log_gains", upstream * gain * light), ("offsets", upstream)):
            like = self.parameters[name]
            whole = like.new_zeros(like.shape)
            whole[index] = value.sum(dim=(1, 2))
            self._add(name, whole)
        return gain * upstream

    def undone(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        found = self._of(shot)
        return light if found is None else (light - found[2]) / found[1]

    def settle(self) -> None:
        """Mean of the log gains and of the offsets 0."""
        for parameter in self.parameters.values():
            value = parameter.detach()
            value -= value.mean(dim=0, keepdim=True)

    def for_photos(self, names: Iterable[str]) -> Exposure:
        """Of these photos only, with their mean gain 1: others, whose exposure nobody has learned, pass unchanged."""
        wanted = set(names)
        kept = [i for i, name in enumerate(self.names) if name in wanted]
        gains, offsets = (self.parameters[name].detach()[kept].clone() for name in ("log_gains", "offsets"))
        exposure = Exposure([self.names[i] for i in kept], gains, offsets)
        if kept:
            exposure.settle()
        return exposure

    def described(self) -> Mapping[str, object]:
        """Gain of each channel by photo."""
        return {
            name: [round(float(v), 4) for v in row.exp()]
            for name, row in zip(self.names, self.parameters["log_gains"].detach(), strict=True)
        }
