"""Effects in the order in which light meets them, around the medium's blur."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from torch import Tensor

from ...colour import decoding_slope, encoding_slope, linear_to_srgb, srgb_to_linear
from ..medium import Medium
from .effect import Effect, Shot


@dataclass
class Formation:
    """The chain.

    Attributes:
        effects: in any order; those before the blur come first, each group in the given order.
    """

    effects: Sequence[Effect] = field(default_factory=tuple)
    _last: tuple[Tensor, Shot, list[Tensor], Tensor] | None = field(default=None, init=False, repr=False, compare=False)

    def __bool__(self) -> bool:
        return bool(self.effects)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is on."""
        return tuple(effect.name for effect in self.effects)

    @property
    def light(self) -> list[Effect]:
        """Effects before the blur."""
        return [effect for effect in self.effects if effect.place == "light"]

    @property
    def kernels(self) -> list[Effect]:
        """Effects within the blur."""
        return [effect for effect in self.effects if effect.place == "kernel"]

    @property
    def sensor(self) -> list[Effect]:
        """Effects behind the blur."""
        return [effect for effect in self.effects if effect.place == "sensor"]

    @property
    def by_depth(self) -> bool:
        """Whether the render's depth is needed."""
        return any(effect.by_depth for effect in self.effects)

    def reach(self, width: int, height: int) -> float:
        """Standard deviation (px) of what spreads light from outside into a photo of this size, px."""
        return math.hypot(*(effect.reach(math.hypot(width, height)) for effect in self.light))

    def through(self, medium: Medium, names: Iterable[str]) -> Medium:
        """The medium with the point spreads that effects of the kernel give the named photos; may be the same one.

        Whoever simulates the chain takes this medium, on the grid of the photos that the effects were told from.
        """
        own = {}
        for name in names if self.kernels else ():
            psf = shared = medium.psf_for(name)
            for effect in self.kernels:
                psf = effect.point_spread(psf, name)
            if psf is not shared:
                own[name] = psf
        return replace(medium, per_view={**medium.per_view, **own}) if own else medium

    def degrade(self, frame: Tensor, blur: Callable[[Tensor], Tensor], medium: Medium, shot: Shot) -> Tensor:
        """[3, H + 2m, W + 2m] sRGB render -> [3, H, W] sRGB photo; without effects exactly `Medium.degrade`."""
        if not self.effects:
            return medium.degrade(frame, blur)
        photo = medium.degrade(self.reached(frame, shot), blur)
        return self.filed(photo, shot)

    def reached(self, frame: Tensor, shot: Shot) -> Tensor:
        """The sharp frame (sRGB) as its light reaches the blurring medium; the very same tensor where nothing is on."""
        effects = self.light
        if not effects:
            return frame
        stages = self._stages(frame, shot)
        # The gradient of the same step asks for them again.
        encoded = linear_to_srgb(stages[-1])
        self._last = None if encoded.requires_grad else (frame, shot, stages, encoded)
        return encoded

    def _stages(self, frame: Tensor, shot: Shot) -> list[Tensor]:
        """Linear light in front of every effect, and behind the last one."""
        stages = [srgb_to_linear(frame)]
        for effect in self.light:
            stages.append(effect.forward(stages[-1], shot))
        return stages

    def reached_gradient(self, upstream: Tensor, frame: Tensor, shot: Shot) -> Tensor:
        """Gradient in `frame`, given that in `reached(frame)`; adds those in the effects' parameters."""
        effects = self.light
        if not effects:
            return upstream
        last, self._last = self._last, None
        if last is not None and last[0] is frame and last[1] is shot:
            stages, encoded = last[2:]
        else:
            stages = self._stages(frame, shot)
            encoded = linear_to_srgb(stages[-1])
        gradient = upstream * encoding_slope(stages[-1], encoded)
        for effect, light in zip(reversed(effects), reversed(stages[:-1]), strict=True):
            gradient = effect.gradient(gradient, light, shot)
        return gradient * decoding_slope(frame, stages[0])

    def filed(self, photo: Tensor, shot: Shot) -> Tensor:
        """What the camera files of a blurred view (sRGB): gains and losses of lens and sensor, then clipping."""
        effects = self.sensor
        if not effects:
            return photo
        light = srgb_to_linear(photo)
        for effect in effects:
            light = effect.forward(light, shot)
        return linear_to_srgb(light).clamp(0.0, 1.0)

    def unfiled(self, photo: Tensor, shot: Shot) -> Tensor:
        """A filed photo (sRGB) with the effects of lens and sensor undone; may pass 1 where the photo was dark."""
        effects = self.sensor
        if not effects:
            return photo
        light = srgb_to_linear(photo)
        for effect in reversed(effects):
            light = effect.undone(light, shot)
        return linear_to_srgb(light)
