"""Media that Cycles renders itself: a lens with an aperture, motion during the exposure, fog.

Nothing here is a convolution: rays start on a disc, objects move while light arrives, light scatters in a
volume. The sharp truth beside such photos is the same scene through a pinhole, at the middle of the
exposure, in clear air.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ..axes import camera_to_blender, place_camera, points_to_blender
from . import stage
from .settings import OBJECT_INDEX, SynthesizeSettings

#: Half the side of the box of fog, in viewing distances: the cameras stand inside.
FOG_REACH = 1.5


@contextmanager
def rendered_medium(settings: SynthesizeSettings, cameras: list[Camera], target: NDArray[np.float64]) -> Iterator[None]:
    """Inside, pictures are rendered through what the settings ask for; `frame` prepares each of them.

    Args:
        target: [3] middle of the object in Blender's world; the lens focuses there if `settings.focus` is 0.
    """
    with ExitStack() as stack:
        if settings.fog > 0:
            distance = float(np.median([np.linalg.norm(_place(camera) - target) for camera in cameras]))
            stack.enter_context(stage.fog(settings.fog, settings.fog_anisotropy, target, FOG_REACH * distance))
        if settings.moves:
            stack.enter_context(stage.open_shutter())
        yield


@contextmanager
def frame(
    settings: SynthesizeSettings, camera: Camera, along: NDArray[np.float64], target: NDArray[np.float64]
) -> Iterator[None]:
    """Sets the lens and the motion of one photo, and takes them back.

    Args:
        along: [3] unit vector in Blender's world in which the camera travels.
    """
    scene = bpy.context.scene
    place_camera(scene.camera, camera, scene.render)
    with ExitStack() as stack:
        if settings.aperture > 0:
            # The frame with overscan is a larger sensor behind a shorter lens for Blender; the hole stays as large.
            hole = camera_to_blender(camera).lens / 1000 / settings.aperture
            wide = camera.with_margin(settings.overscan)
            stack.enter_context(stage.lens(wide, hole, focus_distance(settings, camera, target)))
        if settings.camera_motion > 0:
            stack.enter_context(stage.moving(scene.camera, along * settings.camera_motion / 1000))
        if any(settings.object_motion):
            step = np.array(settings.object_motion) / 1000
            for item in scene.objects:
                if item.pass_index == OBJECT_INDEX and (item.parent is None or item.parent.pass_index != OBJECT_INDEX):
                    stack.enter_context(stage.moving(item, step))
        yield


def travel(cameras: list[Camera]) -> NDArray[np.float64]:
    """[V, 3] unit vectors in Blender's world along the path of the cameras; to the right where there is none."""
    places = np.array([_place(camera) for camera in cameras])
    steps = np.gradient(places, axis=0) if len(places) > 1 else np.zeros((1, 3))
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    right = np.array([points_to_blender(camera.rotation[0]) for camera in cameras])
    return np.where(lengths > 1e-9, steps / np.maximum(lengths, 1e-9), right)


def focus_distance(settings: SynthesizeSettings, camera: Camera, target: NDArray[np.float64]) -> float:
    """Depth (along the camera's axis, in the scene's units) that is sharp."""
    if settings.focus > 0:
        return settings.focus
    forward = points_to_blender(camera.rotation[2])
    return float((target - _place(camera)) @ forward)


def _place(camera: Camera) -> NDArray[np.float64]:
    return np.asarray(points_to_blender(camera.centre))
