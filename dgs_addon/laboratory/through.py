"""What stands between the object and each photo of a set: its media, planned before anything is rendered."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ..axes import points_to_engine
from .media.medium import Medium, Stage, Truth, Views
from .media.registry import medium_of
from .settings import SynthesizeSettings
from .studio import Studio

#: Width (px) of the depth maps that media are planned by.
_SURVEYED = 64


@dataclass(frozen=True)
class Through:
    """The media of a set.

    Attributes:
        held_out: names of the views that are to be held out.
        clear: [V] photos that have nothing which differs from photo to photo.
        media: name -> the medium and what is true of each photo.
    """

    held_out: list[str]
    clear: list[bool]
    media: dict[str, tuple[Medium, list[Truth]]]

    def is_sharp(self, index: int) -> bool:
        """Whether the photo is the sharp picture."""
        return not self._of(index)

    def to_json(self, cameras: list[Camera]) -> dict[str, Any]:
        """For the manifest; nothing where there are no media."""
        if not self.media:
            return {}
        return {
            "held_out": self.held_out,
            "media": {name: medium.constants() for name, (medium, _) in self.media.items()},
            "through": {
                camera.name: {"sharp": self.is_sharp(index), **{name: plan[index] for name, plan in self._of(index)}}
                for index, camera in enumerate(cameras)
            },
        }

    @contextmanager
    def standing(self, stage: Stage) -> Iterator[None]:
        """Inside, what stands there for all photos is there."""
        with ExitStack() as stack:
            for medium, plan in self.media.values():
                stack.enter_context(medium.standing(stage, plan))
            yield

    @contextmanager
    def photo(self, stage: Stage, camera: Camera, index: int) -> Iterator[None]:
        """Inside, the scene is set for one photo; `camera` is the frame that is rendered."""
        with ExitStack() as stack:
            for name, plan in self._of(index):
                stack.enter_context(self.media[name][0].photo(stage, camera, plan[index]))
            yield

    def _of(self, index: int) -> list[tuple[str, list[Truth]]]:
        """Names and plans of the media that the photo is taken through."""
        kept = self.media.items()
        return [(name, plan) for name, (medium, plan) in kept if medium.every_photo or not self.clear[index]]


def plan(settings: SynthesizeSettings, cameras: list[Camera], studio: Studio) -> Through:
    """What is true of every photo.

    Raises:
        DgsError: a medium does not fit the scene.
    """
    every = settings.holdout_every
    held = [every > 0 and index % every == 0 for index in range(len(cameras))]
    clear = _clear(held, settings.sharp_share, settings.seed)
    depths = cache(lambda: _depths(cameras, studio))
    views = Views(cameras, points_to_engine(studio.target), clear, settings.seed, depths)
    media = {}
    for text in settings.media:
        medium = medium_of(text)
        media[text.partition(":")[0]] = medium, medium.plan(views)
    return Through([camera.name for camera, out in zip(cameras, held, strict=True) if out], clear, media)


def _clear(held: list[bool], share: float, seed: int) -> list[bool]:
    """Held-out photos, and a share of the others that is drawn."""
    others = [index for index, out in enumerate(held) if not out]
    drawn = np.random.default_rng((seed, 31)).permutation(others)[: round(share * len(others))]
    return [out or index in drawn for index, out in enumerate(held)]


def _depths(cameras: list[Camera], studio: Studio) -> list[NDArray[np.float32]]:
    render = studio.enter()
    with TemporaryDirectory(prefix="dgs-render-") as scratch, render.geometry_only():
        small = [camera.resized(_SURVEYED, round(_SURVEYED * camera.height / camera.width)) for camera in cameras]
        return [render.depth_and_index(camera, Path(scratch))[0] for camera in small]
