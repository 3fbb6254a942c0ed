"""Cameras of Blender's pictures and 3D views as the engine's.

The engine has pinhole cameras only. A view without perspective is one from far away through a long lens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.camera import Camera
from ...core.errors import CameraError
from ..axes import CAMERA_FLIP, ENGINE_FROM_BLENDER, camera_to_engine, points_to_engine, read_settings

#: How many widths of the picture the camera of a view without perspective stands back: over a scene as deep as the
#: picture is wide, sizes then differ by a thousandth from near to far.
_FAR_BACK = 1000.0


@dataclass(frozen=True)
class Frame:
    """The part of a picture that is rendered.

    Attributes:
        width, height: of the whole picture, px.
        left, bottom, right, top: edges of the part, px from the left and from the bottom.
    """

    width: int
    height: int
    left: int
    bottom: int
    right: int
    top: int

    @staticmethod
    def of(render: Any, width: int, height: int) -> Frame:
        """What `bpy` render settings ask for of a picture of this size."""
        if not render.use_border:
            return Frame(width, height, 0, 0, width, height)
        edges = (render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y)
        left, bottom, right, top = (int(e * side) for e, side in zip(edges, (width, height) * 2, strict=True))
        return Frame(width, height, left, bottom, max(right, left + 1), max(top, bottom + 1))

    def part(self, camera: Camera) -> Camera:
        """The camera of the part, given that of the whole picture."""
        cx, cy = camera.cx - self.left, camera.cy - (self.height - self.top)
        return replace(camera, width=self.right - self.left, height=self.top - self.bottom, cx=cx, cy=cy)


def final_camera(thing: Any, render: Any, frame: Frame) -> tuple[Camera, float]:
    """The camera of a final picture, and how far behind Blender's it stands (scene's units).

    Args:
        thing: evaluated `bpy` camera object; render: `bpy` render settings.

    Raises:
        CameraError: the engine has no such camera.
    """
    kind = thing.data.type
    if kind not in ("PERSP", "ORTHO"):
        raise CameraError("Descatter renders no panoramas", "Choose a perspective or an orthographic camera")
    settings = read_settings(thing, render)
    back = 0.0
    if kind == "ORTHO":
        # The frame is as wide as the scale at the distance that the camera is set back by.
        back, settings = _set_back(settings.matrix_world, thing.data.ortho_scale, settings)
    return frame.part(camera_to_engine(settings, frame.width, frame.height, thing.name)), back


def _set_back(matrix: NDArray[np.float64], width: float, settings: Any) -> tuple[float, Any]:
    back = _FAR_BACK * width
    moved = matrix.copy()
    moved[:3, 3] += back * matrix[:3, 2]
    sensor = settings.sensor_height if settings.sensor_fit == "VERTICAL" else settings.sensor_width
    return back, replace(settings, matrix_world=moved, lens=sensor * _FAR_BACK)


def window_camera(view: ArrayLike, window: ArrayLike, width: int, height: int) -> tuple[Camera, float]:
    """The camera of a 3D view, and how far behind Blender's it stands (scene's units).

    Args:
        view: [4, 4] world to view, OpenGL's axes; window: [4, 4] OpenGL's projection.
        width, height: px.
    """
    view, window = np.asarray(view, np.float64), np.asarray(window, np.float64)
    turn = view[:3, :3] / np.linalg.norm(view[:3, :3], axis=1, keepdims=True)
    eye = -turn.T @ view[:3, 3]
    sides = np.array([width, height]) / 2
    scales, shifts = np.diag(window)[:2], window[:2, 2]
    back = 0.0
    if abs(window[3, 3]) > 0.5:  # without perspective
        back = _FAR_BACK * 2.0 / float(scales.min())
        eye = eye + back * turn[2]
        scales, shifts = scales * back, -window[:2, 3]
    rotation = CAMERA_FLIP @ turn @ ENGINE_FROM_BLENDER.T
    focal = scales * sides
    centre = sides * (1 - shifts * np.array([1.0, -1.0]))
    place = -rotation @ points_to_engine(eye)
    fx, fy, cx, cy = (float(value) for value in (*focal, *centre))
    return Camera("", width, height, fx, fy, cx, cy, rotation, place), back
