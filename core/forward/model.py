"""One photo's light from the Gaussians to the camera's file, forwards and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import torch
from torch import Tensor

from ..camera import Camera
from ..colour import srgb_to_linear
from ..frames import in_a_row
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation, Passage
from ..imaging.formation.effect import Shot
from ..imaging.psf import PointSpread
from ..rasterizer import (
    Depths,
    RasterSettings,
    Rendered,
    RenderedPath,
    ScreenStatistics,
    blended_depths,
    render,
    render_path,
    with_gradient,
)
from ..rendering import OPAQUE_ENOUGH
from .collecting import SRGB, Collected, collected
from .medium import MediumModel, SubFrame
from .surface import surface_depth, where_they_agree
from .through_layers import ThroughLayers, layered_focus, through_layers


class Exposure(Protocol):
    """A photo to be predicted: its camera, on the grid and in the scene's own units, and its blur on that grid."""

    @property
    def name(self) -> str: ...

    @property
    def camera(self) -> Camera: ...

    @property
    def psf(self) -> PointSpread | None: ...


def sharp_view(
    gaussians: Gaussians, camera: Camera, settings: RasterSettings, background: Tensor | None = None
) -> Rendered:
    """What a camera sees without any medium: image, opacity and, if asked for, depth; differentiable.

    Args:
        background: [3] sRGB; black if None.
    """
    return render(gaussians, camera, background=background, settings=settings)


def sharp_depths(
    gaussians: Gaussians,
    camera: Camera,
    settings: RasterSettings = RasterSettings(),
    *,
    held: float = 0.5,
    centres: bool = False,
) -> Depths:
    """How far away a camera sees the twin, px by px; see `core.rasterizer.blended_depths`."""
    return blended_depths(gaussians, camera, settings, held=held, centres=centres)


@dataclass(frozen=True)
class SharpFrame:
    """One of the frames that a photo's light is collected from.

    Attributes:
        passage: of its light through the effects, without gradient; weight: share of the photo's light, the mean of
            all rows.
    """

    passage: Passage
    weight: float


@dataclass(frozen=True)
class PassedTogether:
    """Light of the frames along a path that passes the effects once it is collected.

    Light adds up, so that is the same but for depths, which change along the path: they are those of its middle.

    Attributes:
        passage: of the frames' mean; middle: the frame whose depth the effects go by, with gradient; None where no
            effect does.
    """

    passage: Passage
    middle: Rendered | None


@dataclass(frozen=True)
class Exposed:
    """One photo's light on its way; see `ForwardModel.expose`.

    Attributes:
        medium: of this photo; formation: the effects.
        shot: how the photo is taken, for effects of the sensor.
        frames: what was rendered: one, or several sub-frames of one exposure.
        renders: the same by the rasterizer, with gradient: frame by frame, or those along a path together.
        collected: the frames' light; together: its way through the effects where frames do not pass them one by one.
        layers: the one frame's, where it was rendered in layers: its gradient goes back through them.
    """

    medium: MediumModel
    formation: Formation
    shot: Shot
    frames: tuple[SharpFrame, ...] = field(repr=False)
    renders: tuple[Rendered, ...] | RenderedPath = field(repr=False)
    collected: Collected = field(repr=False)
    together: PassedTogether | None = field(repr=False, default=None)
    layers: ThroughLayers | None = field(repr=False, default=None)

    @property
    def mean_depth(self) -> Tensor | None:
        """[H + 2m, W + 2m] of the first frame; None where depth was not asked for."""
        return None if isinstance(self.renders, RenderedPath) else self.renders[0].mean_depth

    @property
    def screens(self) -> tuple[ScreenStatistics, ...]:
        """What the renders say about each Gaussian."""
        if isinstance(self.renders, RenderedPath):
            return self.renders.screens
        return tuple(rendered.screen for rendered in self.renders)

    @property
    def passages(self) -> list[tuple[Passage, float]]:
        """Ways through the effects, each with its share of the photo's light."""
        if self.together is not None:
            return [(self.together.passage, 1.0)]
        return [(frame.passage, frame.weight) for frame in self.frames]

    @property
    def reached(self) -> Tensor:
        """[3, H + 2m, W + 2m] sRGB: the light as it reaches the medium, without gradient."""
        return self.collected.shown if self.together is None else self.together.passage.reached

    @property
    def degraded(self) -> Tensor:
        """[3, H, W] sRGB: what the medium lets the lens see."""
        return self.medium.degraded(self.reached)

    @property
    def photo(self) -> Tensor:
        """[3, H, W] sRGB: what the camera files, effects of lens and sensor included."""
        return self.formation.filed(self.degraded, self.shot)

    def residual(self, photo: Tensor) -> Tensor:
        """[3, H, W] sRGB: a photo, freed of effects of lens and sensor, less what the twin shows through the medium."""
        return photo - self.degraded

    def backward(self, upstream: Tensor, in_sharp: Tensor | None = None) -> None:
        """Adds gradients to the Gaussians, poses, and effects, given that of a loss in `reached`.

        Args:
            in_sharp: [3, H + 2m, W + 2m] gradient of the loss in the one sharp frame itself, besides.
        """
        if self.layers is not None:
            total = with_gradient(self.layers.reached, upstream)
            if in_sharp is not None:
                total = total + with_gradient(self.layers.view.image, in_sharp)
            total.backward()  # type: ignore[no-untyped-call]
            return
        if self.together is not None:
            upstream = self.together.passage.gradient(upstream)
        shares = self.collected.gradient(upstream)
        parts = [frame.passage.gradient(part) for frame, part in zip(self.frames, shares, strict=True)]
        if isinstance(self.renders, RenderedPath):
            total = with_gradient(self.renders.images, in_a_row(parts))
            if self.together is not None:
                total = _with_depth(total, self.together.passage, self.together.middle)
            total.backward()  # type: ignore[no-untyped-call]
            return
        if in_sharp is not None:
            parts = [part + in_sharp for part in parts]
        each = [
            _with_depth(with_gradient(rendered.image, part), frame.passage, rendered)
            for frame, rendered, part in zip(self.frames, self.renders, parts, strict=True)
        ]
        sum(each[1:], each[0]).backward()  # type: ignore[no-untyped-call]


def _with_depth(derivative: Tensor, passage: Passage, rendered: Rendered | None) -> Tensor:
    """The same zero, which also hands on what the effects' gradient left in the depth of a frame."""
    in_depth, surface = passage.depth_gradient, passage.shot.depth
    if in_depth is None or surface is None or rendered is None:
        return derivative
    return derivative + _in_depth(rendered, where_they_agree(in_depth, surface, rendered))


def _in_depth(rendered: Rendered, upstream: Tensor) -> Tensor:
    """A zero that hands a gradient in the mean depth [h, w] to what it is the mean of."""
    assert rendered.depth is not None
    alpha = rendered.alpha.detach()
    per_alpha = torch.where(alpha > OPAQUE_ENOUGH, upstream / alpha.clamp(min=OPAQUE_ENOUGH), 0.0)
    mean = rendered.depth.detach() / alpha.clamp(min=OPAQUE_ENOUGH)
    return with_gradient(rendered.depth, per_alpha) + with_gradient(rendered.alpha, -per_alpha * mean)


@dataclass(frozen=True)
class ForwardModel:
    """From Gaussians to photos, on one grid.

    Attributes:
        settings: of the rasterizer, with the grid's low-pass (`low_pass_on_grid`).
        medium: of each photo: asked for every exposure, so that photos may have one of their own.
        margin: px of the grid that frames reach beyond their photo on every side (`margin_for`).
        formation: effects besides the blur.
    """

    settings: RasterSettings
    medium: Callable[[Exposure], MediumModel]
    margin: int = 0
    formation: Formation = Formation()

    def sharp(self, gaussians: Gaussians, camera: Camera, background: Tensor | None = None) -> Rendered:
        """What the photo's camera sees without the medium, [3, H + 2m, W + 2m]; differentiable."""
        return sharp_view(gaussians, camera.with_margin(self.margin), self.settings, background)

    def expose(
        self, gaussians: Gaussians, exposure: Exposure, background: Tensor | None = None, overscan: int = 0
    ) -> Exposed:
        """Renders one photo's view and takes its light to the medium.

        Args:
            gaussians: in the scene's own units, as the cameras are.
            background: [3] sRGB colour behind everything; black if None.
            overscan: px around the photo that are predicted along with it (what a lens's distortion will need).
        """
        camera, medium, motion = exposure.camera, self.medium(exposure), self.formation.motion
        wide = camera.with_margin(overscan).with_margin(self.margin)
        poses = None if motion is None else motion.poses(exposure.name, camera)
        size, middle = (camera.height, camera.width), (camera.cx, camera.cy)
        shot = Shot(exposure.name, *size, overscan + self.margin, middle)
        if poses is not None and len(poses) > 1:
            return self._along_path(gaussians, wide, poses, background, shot, medium)
        subs = medium.sub_frames(wide) if poses is None else self._one_by_one(wide, poses.to(gaussians.means))
        if len(subs) == 1 and subs[0].pose is None:
            layered = self._in_layers(gaussians, subs[0], background, shot, medium)
            if layered is not None:
                return layered
        renders = tuple(
            render(gaussians, sub.camera, background=background, pose=sub.pose, settings=self.settings) for sub in subs
        )
        depths = [self.surface(gaussians, sub, drawn) for drawn, sub in zip(renders, subs, strict=True)]
        shots = [replace(shot, depth=depth) for depth in depths]
        passages = [self.formation.passage(r.image.detach(), one) for r, one in zip(renders, shots, strict=True)]
        frames = tuple(SharpFrame(p, sub.weight) for p, sub in zip(passages, subs, strict=True))
        space = medium.space if poses is None else "linear"  # a sensor collects light
        curve = SRGB if motion is None else motion.curve
        light = collected([p.reached for p in passages], [sub.weight for sub in subs], space, curve)
        return Exposed(medium, self.formation, shots[0], frames, renders, light)

    def _in_layers(
        self, gaussians: Gaussians, sub: SubFrame, background: Tensor | None, shot: Shot, medium: MediumModel
    ) -> Exposed | None:
        """What a lens out of focus shows; None where the frame is to pass the effects as one picture."""
        focus = layered_focus(self.formation, shot.name)
        if focus is None:
            return None
        layers = through_layers(gaussians, sub.camera, background, self.settings, focus, shot)
        if layers is None:
            return None
        shot = replace(shot, depth=self.surface(gaussians, sub, layers.view))
        image, reached = layers.view.image.detach(), layers.reached.detach()
        passage = Passage(image, shot, [focus], [srgb_to_linear(image), srgb_to_linear(reached)], reached)
        light = collected([reached], [1.0], medium.space)
        frames, renders = (SharpFrame(passage, 1.0),), (layers.view,)
        return Exposed(medium, self.formation, shot, frames, renders, light, layers=layers)

    def _along_path(
        self,
        gaussians: Gaussians,
        camera: Camera,
        poses: Tensor,
        background: Tensor | None,
        shot: Shot,
        medium: MediumModel,
    ) -> Exposed:
        """What a sensor collects along a path, poses [K, 3, 4]; the effects see its light together."""
        plain = replace(self.settings, depth=False)
        renders = render_path(gaussians, camera, poses, background=background, settings=plain)
        still = Formation()
        motion = self.formation.motion
        assert motion is not None
        rows = motion.row_weights(len(poses), shot.height, shot.width, shot.margin)
        shares = [1.0 / len(poses)] * len(poses) if rows is None else rows.mean(dim=(1, 2)).tolist()
        images = renders.images.detach()
        frames = tuple(SharpFrame(still.passage(i, shot), share) for i, share in zip(images, shares, strict=True))
        light = collected([f.passage.reached for f in frames], shares if rows is None else rows, "linear", motion.curve)
        if not self.formation.light:
            return Exposed(medium, self.formation, shot, frames, renders, light)
        middle: Rendered | None = None
        if self.settings.depth:
            sub = SubFrame(camera, poses[len(poses) // 2].to(gaussians.means))
            middle = render(gaussians, camera, background=background, pose=sub.pose, settings=self.settings)
            shot = replace(shot, depth=self.surface(gaussians, sub, middle))
        together = PassedTogether(self.formation.passage(light.shown, shot), middle)
        return Exposed(medium, self.formation, shot, frames, renders, light, together)

    def surface(self, gaussians: Gaussians, frame: SubFrame, rendered: Rendered) -> Tensor | None:
        """[h, w] depth that effects follow, of a frame as it was rendered; None where no depth was asked for.

        Light through haze is that of all that is seen, so its depth is their mean; a blur is its surface's.
        """
        if not self.formation.by_surface:
            return rendered.mean_depth
        return surface_depth(gaussians, frame, self.settings, rendered)

    @staticmethod
    def _one_by_one(camera: Camera, poses: Tensor) -> list[SubFrame]:
        return [SubFrame(camera, pose, 1.0 / len(poses)) for pose in poses]
