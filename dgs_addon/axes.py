"""The one place where Blender's axes and the engine's meet. Needs numpy only.

World:   Blender x right, y away, z up;  engine (COLMAP) x right, y down, z away:

    p_engine = (x, -z, y),   p_blender = (x, z, -y)

Camera:  Blender looks along -z with y up; the engine's camera looks along +z with y down.
Frame:   Blender's rows run upwards; the engine's run downwards, pixel centres at +0.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.camera import Camera

SensorFit = Literal["AUTO", "HORIZONTAL", "VERTICAL"]

#: Rotation from Blender's world to the engine's.
ENGINE_FROM_BLENDER: NDArray[np.float64] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: A Blender camera's axes in terms of the engine camera's: y and z point the other way.
CAMERA_FLIP: NDArray[np.float64] = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class BlenderCamera:
    """What Blender stores about a camera that a pinhole model can express.

    Attributes:
        matrix_world: [4, 4] camera to Blender's world, without scale.
        lens, sensor_width, sensor_height: mm.
        sensor_fit: which side of the frame the sensor is fitted to.
        shift_x, shift_y: shift of the principal point as a share of the fitted side.
        pixel_aspect_x, pixel_aspect_y: shape of a pixel, as in the render settings.
    """

    matrix_world: NDArray[np.float64]
    lens: float
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: SensorFit = "HORIZONTAL"
    shift_x: float = 0.0
    shift_y: float = 0.0
    pixel_aspect_x: float = 1.0
    pixel_aspect_y: float = 1.0


def points_to_engine(points: ArrayLike) -> NDArray[np.float64]:
    """[..., 3] points or directions of Blender's world in the engine's."""
    return np.asarray(points, dtype=np.float64) @ ENGINE_FROM_BLENDER.T


def points_to_blender(points: ArrayLike) -> NDArray[np.float64]:
    """[..., 3] points or directions of the engine's world in Blender's."""
    return np.asarray(points, dtype=np.float64) @ ENGINE_FROM_BLENDER


def matrix_to_engine(matrix_world: ArrayLike) -> NDArray[np.float64]:
    """[4, 4] object-to-world matrix of Blender as object-to-world of the engine."""
    return _homogeneous(ENGINE_FROM_BLENDER) @ np.asarray(matrix_world, dtype=np.float64)


def matrix_to_blender(matrix: ArrayLike) -> NDArray[np.float64]:
    """[4, 4] object-to-world matrix of the engine as object-to-world of Blender."""
    return _homogeneous(ENGINE_FROM_BLENDER.T) @ np.asarray(matrix, dtype=np.float64)


def camera_to_engine(camera: BlenderCamera, width: int, height: int, name: str) -> Camera:
    """The pinhole camera of a frame of `width` x `height` px that Blender renders with `camera`."""
    ax, ay = camera.pixel_aspect_x, camera.pixel_aspect_y
    horizontal = _fits_horizontally(camera.sensor_fit, width * ax, height * ay)
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    side = width * ax if horizontal else height * ay  # in units of square pixels
    focal = camera.lens / sensor * side
    rotation, position = _pose_to_engine(camera.matrix_world)
    return Camera(
        name=name,
        width=width,
        height=height,
        fx=focal / ax,
        fy=focal / ay,
        cx=width / 2 - camera.shift_x * side / ax,
        cy=height / 2 + camera.shift_y * side / ay,
        rotation=rotation,
        translation=-rotation @ position,
    )


def camera_to_blender(camera: Camera, sensor: float = 36.0) -> BlenderCamera:
    """Blender's settings that render exactly the frame of `camera`.

    A focal length that differs between x and y becomes a pixel aspect, as Blender has one lens.
    Blender accepts pixel aspects of at least 1, so that the longer side of a pixel is scaled.
    """
    ax, ay = max(1.0, camera.fy / camera.fx), max(1.0, camera.fx / camera.fy)
    side = camera.width * ax
    matrix = np.eye(4)
    matrix[:3, :3] = ENGINE_FROM_BLENDER.T @ camera.rotation.T @ CAMERA_FLIP
    matrix[:3, 3] = points_to_blender(camera.centre)
    return BlenderCamera(
        matrix_world=matrix,
        lens=camera.fx * ax * sensor / side,
        sensor_width=sensor,
        shift_x=(camera.width / 2 - camera.cx) * ax / side,
        shift_y=(camera.cy - camera.height / 2) * ay / side,
        pixel_aspect_x=ax,
        pixel_aspect_y=ay,
    )


def read_settings(camera_object: Any, render: Any) -> BlenderCamera:
    """What decides the picture of a `bpy` camera object under the given `bpy` render settings, but for its size."""
    data = camera_object.data
    return BlenderCamera(
        matrix_world=np.array(camera_object.matrix_world.normalized(), dtype=np.float64),
        lens=data.lens,
        sensor_width=data.sensor_width,
        sensor_height=data.sensor_height,
        sensor_fit=data.sensor_fit,
        shift_x=data.shift_x,
        shift_y=data.shift_y,
        pixel_aspect_x=render.pixel_aspect_x,
        pixel_aspect_y=render.pixel_aspect_y,
    )


def render_size(render: Any) -> tuple[int, int]:
    """Width and height (px) that `bpy` render settings make."""
    share = render.resolution_percentage / 100
    return int(render.resolution_x * share), int(render.resolution_y * share)


def read_camera(camera_object: Any, render: Any, name: str) -> Camera:
    """The engine's camera of a `bpy` camera object under the given `bpy` render settings."""
    return camera_to_engine(read_settings(camera_object, render), *render_size(render), name)


def place_camera(camera_object: Any, camera: Camera, render: Any | None = None) -> None:
    """Gives a `bpy` camera object the pose and lens of `camera`, and `render` its frame size."""
    settings = camera_to_blender(camera)
    data = camera_object.data
    data.type = "PERSP"
    data.lens_unit = "MILLIMETERS"
    data.sensor_fit = settings.sensor_fit
    data.sensor_width = settings.sensor_width
    data.lens = settings.lens
    data.shift_x, data.shift_y = settings.shift_x, settings.shift_y
    # Blender's matrices are assigned row by row from a nested sequence.
    camera_object.matrix_world = settings.matrix_world.T.tolist()
    if render is not None:
        render.resolution_x, render.resolution_y = camera.width, camera.height
        render.resolution_percentage = 100
        render.pixel_aspect_x, render.pixel_aspect_y = settings.pixel_aspect_x, settings.pixel_aspect_y


def _pose_to_engine(matrix_world: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    matrix = np.asarray(matrix_world, dtype=np.float64)
    rotation = CAMERA_FLIP @ matrix[:3, :3].T @ ENGINE_FROM_BLENDER.T
    return rotation, points_to_engine(matrix[:3, 3])


def _fits_horizontally(fit: SensorFit, width: float, height: float) -> bool:
    return width >= height if fit == "AUTO" else fit == "HORIZONTAL"


def _homogeneous(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return matrix
