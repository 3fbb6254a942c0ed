"""Pictures of twins that were cleaned up: hidden and deleted splats are gone, merged and moved ones look as before."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

bpy = pytest.importorskip("bpy")

import bmesh  # noqa: E402
import dgs  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud, cloud_part  # noqa: E402
from dgs.dgs_addon.axes import place_camera  # noqa: E402
from dgs.dgs_addon.drawing.render_engine import ENGINE  # noqa: E402
from dgs.dgs_addon.job.results import attach  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.crop import add_crop_box  # noqa: E402
from dgs.dgs_addon.scene.nodes import SIZE_INPUT, set_splat_input, splat_modifier  # noqa: E402
from dgs.dgs_addon.scene.scene_cameras import PHOTO  # noqa: E402
from dgs.dgs_addon.scene.selection import read_splats  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin, is_twin  # noqa: E402
from dgs.tests.core.serving.test_pictures import crowd  # noqa: E402
from mathutils import Matrix  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_picture_server")
CAMERA = Camera("view", 120, 90, 130.0, 130.0, 60.0, 45.0, np.eye(3), np.array([0.1, 0.0, 0.2]))


@pytest.fixture
def twin() -> Iterator[Any]:
    dgs.register()
    scene = bpy.context.scene
    scene.render.engine = ENGINE
    scene.view_settings.view_transform, scene.render.dither_intensity = "Standard", 0.0
    scene.render.image_settings.file_format = "PNG"
    place_camera(new_camera("view", scene), CAMERA, scene.render)
    yield added("twin")
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    dgs.unregister()


def added(name: str, rows: slice = slice(None)) -> Any:
    """A twin of some of the splats, active and selected as the only one."""
    cloud = crowd()
    thing = add_twin(cloud_part(cloud, np.arange(len(cloud))[rows]), name, bpy.context.scene.collection)
    for other in bpy.context.selected_objects:
        other.select_set(False)
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()
    return thing


def rendered(path: Path) -> np.ndarray:
    """[H, W, C] 8 bit as int."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return np.asarray(Image.open(path)).astype(int)


def pick(rows: range) -> None:
    """Selects these splats and no others, in Edit Mode."""
    points = bmesh.from_edit_mesh(bpy.context.object.data)
    for number, point in enumerate(points.verts):
        point.select = number in rows
    bmesh.update_edit_mesh(bpy.context.object.data)


def test_hidden_and_deleted_splats_are_gone_also_in_edit_mode(twin: Any, tmp_path: Path) -> None:
    count = len(twin.data.vertices)
    whole = rendered(tmp_path / "a.png")
    half = range(count // 2)
    bpy.ops.dgs.edit_splats()
    pick(range(count))
    assert np.abs(rendered(tmp_path / "b.png") - whole).max() == 0, "no tint in a final picture"
    pick(half)
    bpy.ops.dgs.hide_splats()
    edited = rendered(tmp_path / "c.png")
    bpy.ops.dgs.edit_splats()
    hidden = rendered(tmp_path / "d.png")
    twin.hide_render = True
    rest = added("rest", slice(count // 2, None))
    wanted = rendered(tmp_path / "e.png")
    assert np.abs(wanted - whole).max() > 60
    assert np.abs(hidden - wanted).max() <= 1 and np.abs(edited - wanted).max() <= 1
    bpy.data.objects.remove(rest)
    twin.hide_render = False
    bpy.context.view_layer.objects.active = twin
    bpy.ops.dgs.edit_splats()
    bpy.ops.dgs.show_splats()
    pick(range(count // 2, count))
    bpy.ops.dgs.hide_splats()
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.dgs.delete_splats()
    bpy.ops.dgs.show_splats()
    assert np.abs(rendered(tmp_path / "f.png") - wanted).max() <= 1


def test_what_is_merged_and_moved_for_good_looks_as_before(twin: Any, tmp_path: Path) -> None:
    """Glossy splats, turned, scaled, cropped and enlarged: the picture is the same to one step of 255."""
    other = added("other", slice(0, None, 2))
    other.matrix_world = Matrix.Translation((0.3, 0.2, 0.1)) @ Matrix.Rotation(1.1, 4, (1, 2, 3)) @ other.matrix_world
    other.matrix_world = other.matrix_world @ Matrix.Scale(0.9, 4)
    twin.matrix_world = Matrix.Rotation(0.3, 4, (0, 1, 0)) @ twin.matrix_world @ Matrix.Scale(1.1, 4)
    set_splat_input(splat_modifier(other), SIZE_INPUT, 0.7)
    box = add_crop_box(twin, bpy.context.scene.collection)
    box.scale = [0.6 * value for value in box.scale]
    bpy.context.view_layer.update()
    before = rendered(tmp_path / "a.png")
    assert before.std() > 30
    twin.select_set(True)
    bpy.context.view_layer.objects.active = twin
    assert bpy.ops.dgs.merge_twins() == {"FINISHED"}
    assert [thing for thing in bpy.data.objects if is_twin(thing)] == [twin]
    merged = rendered(tmp_path / "b.png")
    assert np.abs(merged - before).max() <= 1
    twin.matrix_world = Matrix.Rotation(0.8, 4, (3, 1, 2)) @ twin.matrix_world
    bpy.context.view_layer.update()
    turned = rendered(tmp_path / "c.png")
    assert np.abs(turned - before).mean() > 5
    assert bpy.ops.dgs.apply_transform() == {"FINISHED"}
    assert np.abs(rendered(tmp_path / "d.png") - turned).max() <= 1


def test_the_engine_says_which_splats_no_photo_sees(twin: Any) -> None:
    """A wall between three cameras and a clump behind it: frames have the clump, photos do not see it."""
    random = np.random.default_rng(2)
    across, up = np.meshgrid(np.linspace(-3, 3, 41), np.linspace(-3, 3, 41))
    wall = np.stack([across.ravel(), up.ravel(), np.full(across.size, 6.0)], axis=1)
    behind = np.array([0.0, 0.0, 8.0]) + 0.1 * random.normal(size=(30, 3))
    means = np.concatenate([wall, behind]).astype(np.float32)
    count = len(means)
    cloud = GaussianCloud(
        means,
        np.full((count, 3), np.log(0.15), np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full(count, 6.0, np.float32),
        random.normal(size=(count, 4, 3)).astype(np.float32),
    )
    scene = bpy.context.scene
    thing = add_twin(cloud, "wall", scene.collection)
    bpy.context.view_layer.objects.active = thing
    for number, shift in enumerate((-0.5, 0.0, 0.5)):
        eye = new_camera(f"photo {number}", scene)
        place_camera(eye, CAMERA.moved(CAMERA.rotation, np.array([shift, 0.0, 0.0])))
        eye[PHOTO] = f"{number}.png"
        attach([eye], thing)
    bpy.context.view_layer.update()
    bpy.ops.dgs.select_floaters(island=0, weighed=False)
    assert not read_splats(thing).selected[-30:].any(), "all frames have them"
    assert bpy.ops.dgs.select_floaters(island=0) == {"FINISHED"}
    chosen = read_splats(thing).selected
    assert chosen[-30:].all(), "no photo sees them"
    inner = (np.abs(wall) < [1.5, 1.0, 9.0]).all(axis=1)
    assert inner.sum() > 50 and not chosen[:-30][inner].any()
    pick(range(count - 30))
    bpy.ops.dgs.hide_splats()
    bpy.ops.dgs.select_floaters(island=0)
    assert read_splats(thing).selected.sum() < 10, "without the wall photos see them, but for what they hide themselves"
