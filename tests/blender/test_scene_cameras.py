"""COLMAP's cameras in Blender project as COLMAP's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.conventions import rotation_from_quaternion  # noqa: E402
from dgs.core.errors import FormatError  # noqa: E402
from dgs.core.formats.colmap import write_model  # noqa: E402
from dgs.core.formats.transforms import write_transforms  # noqa: E402
from dgs.core.reconstruction import no_points  # noqa: E402
from dgs.dgs_addon.axes import points_to_blender, read_camera  # noqa: E402
from dgs.dgs_addon.scene.cameras import add_cameras  # noqa: E402
from mathutils import Vector  # noqa: E402
from PIL import Image  # noqa: E402


def _cameras() -> dict[str, Camera]:
    generator = np.random.default_rng(5)
    first = Camera("A 1.png", 320, 200, 410.0, 410.0, 171.5, 90.25, np.eye(3), np.zeros(3))
    rotation = rotation_from_quaternion(np.array([1.0, 0.2, -0.3, 0.1]))
    return {first.name: first, "b.png": replace(first, name="b.png").moved(rotation, generator.normal(size=3))}


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_points_fall_on_the_same_pixels(tmp_path: Path, kind: str) -> None:
    cameras = _cameras()
    if kind == "colmap":
        write_model(tmp_path / "cameras", cameras, no_points())
    else:
        write_transforms(tmp_path / "transforms.json", cameras)
    scene = bpy.context.scene
    objects = add_cameras(tmp_path, None, scene)
    bpy.context.view_layer.update()
    assert [thing["dgs_photo"] for thing in objects] == sorted(cameras)
    points = np.random.default_rng(1).normal(size=(20, 3)) * 0.5 + [0, 0, 6]
    for thing in objects:
        camera = cameras[thing["dgs_photo"]]
        for point in points:
            x, y, z = camera.rotation @ point + camera.translation
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
            seen = world_to_camera_view(scene, thing, Vector(points_to_blender(point)))
            assert seen.x * camera.width == pytest.approx(u, abs=1e-2)
            assert (1 - seen.y) * camera.height == pytest.approx(v, abs=1e-2)
            assert seen.z == pytest.approx(z, abs=1e-4)
        back = read_camera(thing, scene.render, camera.name)
        np.testing.assert_allclose(back.rotation, camera.rotation, atol=1e-6)
        np.testing.assert_allclose(back.translation, camera.translation, atol=1e-5)


def test_photos_stand_behind_their_cameras(tmp_path: Path) -> None:
    write_transforms(tmp_path / "transforms.json", _cameras())
    photos = tmp_path / "photos"
    photos.mkdir()
    Image.new("RGB", (320, 200)).save(photos / "a 1.JPG")
    objects = add_cameras(tmp_path / "transforms.json", photos, bpy.context.scene)
    assert objects[0].data.background_images[0].image.name == "a 1.JPG"
    assert objects[0].data.show_background_images
    assert not objects[1].data.background_images


def test_a_folder_without_cameras_is_explained(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="holds no cameras"):
        add_cameras(tmp_path, None, bpy.context.scene)


def test_photos_of_one_name_in_two_folders_stand_behind_their_own_cameras(tmp_path: Path) -> None:
    first, second = list(_cameras().values())[:2]
    write_transforms(tmp_path / "transforms.json", {"left/a.png": first, "right/a.png": second})
    for side, colour in (("left", "red"), ("right", "blue"), (".", "green")):
        (tmp_path / side).mkdir(exist_ok=True)
        Image.new("RGB", (320, 200), colour).save(tmp_path / side / "a.png")
    objects = add_cameras(tmp_path / "transforms.json", tmp_path, bpy.context.scene)
    behind = [Path(thing.data.background_images[0].image.filepath) for thing in objects]
    assert behind == [tmp_path / "left" / "a.png", tmp_path / "right" / "a.png"], "and not one photo behind both"
    assert [thing.name for thing in objects] == ["left/a", "right/a"]
    (tmp_path / "right" / "a.png").unlink()
    objects = add_cameras(tmp_path / "transforms.json", tmp_path, bpy.context.scene)
    assert not objects[1].data.background_images
