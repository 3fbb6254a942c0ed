"""Blender's cameras and the engine's see the same point at the same pixel."""

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.dgs_addon import axes

bpy = pytest.importorskip("bpy")
from bpy_extras.object_utils import world_to_camera_view  # noqa: E402
from mathutils import Euler, Vector  # noqa: E402


@pytest.fixture(autouse=True)
def empty_file():
    bpy.ops.wm.read_factory_settings(use_empty=True)


def camera_object(**lens):
    data = bpy.data.cameras.new("camera")
    for key, value in lens.items():
        setattr(data, key, value)
    item = bpy.data.objects.new("camera", data)
    item.location = (0.3, -1.7, 0.9)
    item.rotation_euler = Euler((1.1, 0.15, 0.4))
    bpy.context.scene.collection.objects.link(item)
    bpy.context.view_layer.update()
    return item


def projected_by_blender(item, points):
    scene = bpy.context.scene
    seen = np.array([world_to_camera_view(scene, item, Vector(p)) for p in points])
    width, height = scene.render.resolution_x, scene.render.resolution_y
    return np.stack([seen[:, 0] * width, (1 - seen[:, 1]) * height], -1), seen[:, 2]


def projected_by_engine(camera, points):
    x, y, z = (axes.points_to_engine(points) @ camera.rotation.T + camera.translation).T
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], -1), z


POINTS = np.random.default_rng(3).uniform(-0.4, 0.4, (20, 3))
LENSES = [
    {"lens": 43.2, "sensor_fit": "HORIZONTAL"},
    {"lens": 28.0, "sensor_fit": "AUTO", "shift_x": 0.1, "shift_y": -0.07},
    {"lens": 50.0, "sensor_fit": "VERTICAL", "sensor_height": 20.0, "shift_y": 0.2},
]


@pytest.mark.parametrize("size", [(800, 533), (300, 500)])
@pytest.mark.parametrize("lens", LENSES)
def test_reads_what_blender_renders(lens, size):
    item = camera_object(**lens)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = size
    pixels, depth = projected_by_blender(item, POINTS)
    ours, z = projected_by_engine(axes.read_camera(item, render, "a.png"), POINTS)
    np.testing.assert_allclose(ours, pixels, atol=2e-3)
    np.testing.assert_allclose(z, depth, rtol=1e-5)


@pytest.mark.parametrize(("fx", "fy"), [(500.0, 500.0), (500.0, 450.0), (450.0, 500.0)])
def test_blender_renders_what_is_placed(fx, fy):
    item = camera_object()
    rotation = np.array(Euler((0.3, -0.2, 0.1)).to_matrix(), dtype=np.float64)
    rotation, _ = np.linalg.qr(rotation)
    rotation *= np.sign(np.linalg.det(rotation))
    camera = Camera("a.png", 640, 400, fx, fy, 300.0, 215.0, rotation, np.array([0.1, -0.2, 3.0]))
    axes.place_camera(item, camera, bpy.context.scene.render)
    bpy.context.view_layer.update()
    pixels, _ = projected_by_blender(item, POINTS)
    ours, _ = projected_by_engine(camera, POINTS)
    np.testing.assert_allclose(ours, pixels, atol=5e-3)
    again = axes.read_camera(item, bpy.context.scene.render, "a.png")
    np.testing.assert_allclose([again.fx, again.fy, again.cx, again.cy], [fx, fy, 300.0, 215.0], rtol=1e-5)
    np.testing.assert_allclose(again.rotation, rotation, atol=1e-6)
    np.testing.assert_allclose(again.centre, camera.centre, atol=1e-6)


def test_world_axes():
    np.testing.assert_allclose(axes.points_to_engine([0, 0, 1]), [0, -1, 0])  # up is -y
    np.testing.assert_allclose(axes.points_to_engine([0, 1, 0]), [0, 0, 1])  # away is z
    np.testing.assert_allclose(axes.points_to_blender(axes.points_to_engine(POINTS)), POINTS)
    matrix = np.eye(4)
    matrix[:3, 3] = POINTS[0]
    np.testing.assert_allclose(axes.matrix_to_engine(matrix)[:3, 3], axes.points_to_engine(POINTS[0]))
    np.testing.assert_allclose(axes.matrix_to_blender(axes.matrix_to_engine(matrix)), matrix)
