"""Effects in the order in which light meets them, around the medium's blur."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from ...colour import decoding_derivative, encoding_derivative, linear_to_srgb, srgb_to_linear
from .effect import Effect, Shot
from .focus import FocusBlur
from .glass import FrostedGlass
from .kernels import PhotoKernels
from .motion import CameraMotion, motion_of


@dataclass(frozen=True)
class Passage:
    """A frame's way through the effects in front of the blur.

    Attributes:
        frame: [3, h, w] sRGB, sharp; shot: how it is taken; effects: that it passes, in order.
        stages: linear light in front of every effect, and behind the last one; empty without effects.
        reached: [3, h, w] sRGB light as it reaches the blurring medium; the very frame without effects.
    """

    frame: Tensor
    shot: Shot
    effects: Sequence[Effect]
    stages: Sequence[Tensor]
    reached: Tensor

    def gradient(self, upstream: Tensor) -> Tensor:
        """Gradient in `frame`, given that in `reached`; adds those in the effects' parameters."""
        if not self.effects:
            return upstream
        gradient = upstream * encoding_derivative(self.stages[-1], self.reached)
        for effect, light in zip(reversed(self.effects), reversed(self.stages[:-1]), strict=True):
            gradient = effect.gradient(gradient, light, self.shot)
        return gradient * decoding_derivative(self.frame, self.stages[0])

    @property
    def depth_gradient(self) -> Tensor | None:
        """[h, w] gradient in the frame's depth that the last call of `gradient` found; None where it goes to none."""
        found = [effect.depth_gradient for effect in self.effects if effect.depth_gradient is not None]
        return sum(found[1:], found[0]) if found else None


@dataclass(frozen=True)
class Formation:
    """The chain.

    Attributes:
        effects: in any order; those before the blur come first, each group in the given order.
    """

    effects: Sequence[Effect] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(self.effects))

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
    def motion(self) -> CameraMotion | None:
        """The camera's path in each exposure."""
        return motion_of(self.effects)

    @property
    def focus(self) -> FocusBlur | None:
        """The photos' own focus."""
        return next((effect for effect in self.effects if isinstance(effect, FocusBlur)), None)

    @property
    def learns_focus(self) -> bool:
        """Whether there is such a one."""
        return self.focus is not None

    @property
    def glass(self) -> FrostedGlass | None:
        """The glass before the camera."""
        return next((effect for effect in self.effects if isinstance(effect, FrostedGlass)), None)

    @property
    def kernels(self) -> PhotoKernels | None:
        """The photos' own kernels."""
        return next((effect for effect in self.effects if isinstance(effect, PhotoKernels)), None)

    @property
    def blurs(self) -> bool:
        """Whether any effect spreads light."""
        return self.motion is not None or self.spreads

    @property
    def spreads(self) -> bool:
        """Whether any effect spreads light even while the camera stands still."""
        return any(effect.reach(1.0) > 0 for effect in self.light)

    def scaled(self, factor: float) -> Formation:
        """The same chain in a world that is `factor` times as large; the very same one where nothing moved."""
        kinds = (CameraMotion, FocusBlur, FrostedGlass)
        if not any(isinstance(effect, kinds) for effect in self.effects):
            return self
        return Formation([e.scaled(factor) if isinstance(e, kinds) else e for e in self.effects])

    @property
    def sensor(self) -> list[Effect]:
        """Effects behind the blur."""
        return [effect for effect in self.effects if effect.place == "sensor"]

    @property
    def by_surface(self) -> bool:
        """Whether that is to be the depth of the surface."""
        return any(effect.by_surface for effect in self.effects)

    @property
    def by_depth(self) -> bool:
        """Whether the render's depth is needed."""
        return any(effect.by_depth for effect in self.effects)

    def reach(self, width: int, height: int) -> float:
        """Standard deviation (px) of what spreads light from outside into a photo of this size, px."""
        return math.hypot(*(effect.reach(math.hypot(width, height)) for effect in self.light))

    def passage(self, frame: Tensor, shot: Shot) -> Passage:
        """The sharp frame's (sRGB) way to the blurring medium, to be gone back by its `gradient`."""
        effects = self.light
        if not effects:
            return Passage(frame, shot, (), (), frame)
        stages = [srgb_to_linear(frame)]
        for effect in effects:
            stages.append(effect.forward(stages[-1], shot))
        return Passage(frame, shot, effects, stages, linear_to_srgb(stages[-1]))

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
