"""One photo's light from the Gaussians to the camera's file, forwards and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from ..camera import Camera
from ..colour import decoding_derivative, encoding_derivative, linear_to_srgb, srgb_to_linear
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation, Passage
from ..imaging.formation.effect import Shot
from ..imaging.medium import BlurSpace
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
from .collecting import CollectedLight
from .medium import MediumModel, SubFrame
from .surface import surface_depth, where_they_agree


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
        passage: of its light through the effects, without gradient; weight: share of the photo's light.
    """

    passage: Passage
    weight: float


@dataclass(frozen=True)
class Exposed:
    """One photo's light on its way; see `ForwardModel.expose`.

    Attributes:
        medium: of this photo; formation: the effects.
        shot: how the photo is taken, for effects of the sensor.
        frames: what was rendered: one, or several sub-frames of one exposure.
        renders: the same by the rasterizer, with gradient: frame by frame, or those along a path together.
        space: in which the light of several frames is collected.
    """

    medium: MediumModel
    formation: Formation
    shot: Shot
    frames: tuple[SharpFrame, ...] = field(repr=False)
    renders: tuple[Rendered, ...] | RenderedPath = field(repr=False)
    space: BlurSpace = "linear"

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

    @cached_property
    def reached(self) -> Tensor:
        """[3, H + 2m, W + 2m] sRGB: the light as it reaches the medium, without gradient."""
        images = [frame.passage.reached for frame in self.frames]
        if len(images) == 1:
            return images[0]
        weights = [frame.weight for frame in self.frames]
        if self.space == "srgb":
            return torch.stack([w * image for w, image in zip(weights, images, strict=True)]).sum(dim=0)
        if self._collected is not None:
            return self._collected.shown
        light = torch.stack([w * srgb_to_linear(image) for w, image in zip(weights, images, strict=True)])
        return linear_to_srgb(light.sum(dim=0))

    @cached_property
    def _collected(self) -> CollectedLight | None:
        """What the sensor collects of several frames in linear light; None where torch has to do it."""
        images = [frame.passage.reached for frame in self.frames]
        if any(image.device.type != "cpu" or image.dtype != torch.float32 for image in images):
            return None
        return CollectedLight(images, [frame.weight for frame in self.frames])

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
        parts = [f.passage.gradient(part) for f, part in zip(self.frames, self._shared(upstream), strict=True)]
        if isinstance(self.renders, RenderedPath):
            with_gradient(self.renders.images, torch.stack(parts)).backward()  # type: ignore[no-untyped-call]
            return
        if in_sharp is not None:
            parts = [part + in_sharp for part in parts]
        total: Tensor | None = None
        for frame, rendered, part in zip(self.frames, self.renders, parts, strict=True):
            derivative = with_gradient(rendered.image, part)
            in_depth = frame.passage.depth_gradient
            surface = frame.passage.shot.depth
            if in_depth is not None and surface is not None:
                derivative = derivative + _in_depth(rendered, where_they_agree(in_depth, surface, rendered))
            total = derivative if total is None else total + derivative
        assert total is not None
        total.backward()  # type: ignore[no-untyped-call]

    def _shared(self, upstream: Tensor) -> list[Tensor]:
        """The gradient in each frame's own light."""
        if len(self.frames) == 1:
            return [upstream]
        if self.space == "srgb":
            return [frame.weight * upstream for frame in self.frames]
        if self._collected is not None:
            return self._collected.gradient(upstream)
        upstream = upstream * encoding_derivative(srgb_to_linear(self.reached), self.reached)
        images = [frame.passage.reached for frame in self.frames]
        return [
            frame.weight * upstream * decoding_derivative(image, srgb_to_linear(image))
            for frame, image in zip(self.frames, images, strict=True)
        ]


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
        renders: tuple[Rendered, ...] | RenderedPath
        seen: list[tuple[Tensor, Tensor | None]]
        if poses is not None and len(poses) > 1 and not self.settings.depth:
            renders = together = render_path(gaussians, wide, poses, background=background, settings=self.settings)
            weights = [1.0 / len(poses)] * len(poses)
            seen = [(image, None) for image in together.images.detach()]
        else:
            subs = medium.sub_frames(wide) if poses is None else self._one_by_one(wide, poses.to(gaussians.means))
            renders = each = tuple(
                render(gaussians, sub.camera, background=background, pose=sub.pose, settings=self.settings)
                for sub in subs
            )
            weights = [sub.weight for sub in subs]
            seen = [
                (drawn.image.detach(), self.surface(gaussians, sub, drawn))
                for drawn, sub in zip(each, subs, strict=True)
            ]
        size, middle = (camera.height, camera.width), (camera.cx, camera.cy)
        shots = [Shot(exposure.name, *size, overscan + self.margin, middle, depth) for _, depth in seen]
        passages = [self.formation.passage(image, shot) for (image, _), shot in zip(seen, shots, strict=True)]
        frames = tuple(SharpFrame(p, weight) for p, weight in zip(passages, weights, strict=True))
        space = medium.space if poses is None else "linear"  # a sensor collects light
        return Exposed(medium, self.formation, shots[0], frames, renders, space)

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
