"""A twin arrives upright, alone and in view; what that changes of the scene is said, and given back when asked."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("pycolmap")

import dgs  # noqa: E402
from dgs import panels  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats.colmap import write_model  # noqa: E402
from dgs.core.formats.ply import write_ply  # noqa: E402
from dgs.core.views import SparsePoints  # noqa: E402
from dgs.dgs_addon.job.results import twin_of  # noqa: E402
from dgs.dgs_addon.scene.arrival import AIR, viewpoint  # noqa: E402
from dgs.dgs_addon.scene.changes import changed_words, hidden_things  # noqa: E402
from dgs.dgs_addon.scene.placing import cameras_of  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402

ENGINE = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"


def results(folder: Path, cloud: GaussianCloud, tilt: float, given: str | None = None) -> Path:
    """A finished run's folder; its three cameras lean by `tilt` radians (about their line of sight)."""
    turn = np.array([[math.cos(tilt), -math.sin(tilt), 0], [math.sin(tilt), math.cos(tilt), 0], [0, 0, 1]])
    cameras = {
        f"{name}.png": Camera(f"{name}.png", 300, 200, 250, 250, 150, 100, turn, np.array([place, 0.0, 0.0]))
        for name, place in (("a", -0.5), ("b", 0.0), ("c", 0.5))
    }
    (folder / "cameras").mkdir(parents=True)
    write_ply(folder / "twin.ply", cloud)
    write_model(folder / "cameras", cameras, SparsePoints(np.array([[0.0, 0, 5]]), np.full((1, 3), 9, np.uint8)))
    report = {
        "photos": {"folder": str(folder)},
        "settings": {"run": {"cameras": given}},
        "medium": {"psf": "none"},
        "heldout": {"degraded": {}, "sharp": {}},
    }
    (folder / "report.json").write_text(json.dumps(report), "utf-8")
    return folder


@pytest.fixture
def scene() -> Iterator[Any]:
    """As Blender opens, with its cube, light and camera."""
    bpy.ops.wm.read_factory_settings(use_empty=False)
    dgs.register()
    bpy.context.scene.render.engine = ENGINE
    yield bpy.context.scene
    dgs.unregister()


def add(scene: Any, out: Path) -> Any:
    scene.dgs.out = str(out)
    assert bpy.ops.dgs.add_results() == {"FINISHED"}
    bpy.context.view_layer.update()
    return twin_of(out, scene)


def settings(scene: Any) -> dict[str, Any]:
    return {
        "engine": scene.render.engine,
        "size": (scene.render.resolution_x, scene.render.resolution_y),
        "view": scene.view_settings.view_transform,
        "camera": scene.camera,
        "bounces": scene.cycles.transparent_max_bounces,
        "samples": scene.cycles.samples,
    }


def test_the_startup_file_is_hidden_and_all_is_given_back(scene: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    before = settings(scene)
    add(scene, results(tmp_path / "out", cloud, 0.0))
    assert settings(scene) != before and scene.camera["dgs_photo"] == "a.png"
    assert [thing.name for thing in hidden_things(scene)] == ["Camera", "Cube", "Light"]
    cube = scene.objects["Cube"]
    assert cube.hide_get() and cube.hide_render
    paper = drawn(panels.DGS_PT_main)
    words = paper.words.replace("\n", " ")
    assert "Hidden: Camera, Cube, Light" in words and {"dgs.give_back", "dgs.dismiss"} <= set(paper.buttons)
    for word in ("render engine", "resolution", "view transform", "camera", "transparent bounces"):
        assert word in words
    assert scene.render.engine == "DESCATTER" and scene.view_settings.view_transform == "Standard"
    cube.name = "my cube"
    assert bpy.ops.dgs.give_back() == {"FINISHED"}
    assert settings(scene) == before and not cube.hide_get() and not cube.hide_render
    assert not changed_words(scene) and not hidden_things(scene)
    assert "dgs.give_back" not in drawn(panels.DGS_PT_main).buttons


def test_what_the_user_changes_later_stays_the_users(scene: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    out = results(tmp_path / "out", cloud, 0.0)
    size = (scene.render.resolution_x, scene.render.resolution_y)
    twin = add(scene, out)
    scene.render.engine, scene.view_settings.view_transform = ENGINE, "Filmic"
    twin.location = (1, 2, 3)
    bpy.ops.object.select_all(action="DESELECT")
    scene.objects["Cube"].hide_set(False)
    assert add(scene, out) == twin  # as an update does
    assert scene.render.engine == ENGINE and scene.view_settings.view_transform == "Filmic"
    assert tuple(twin.location) == (1, 2, 3) and not scene.objects["Cube"].hide_get()
    bpy.ops.dgs.give_back()
    assert scene.view_settings.view_transform == "Filmic"
    assert (scene.render.resolution_x, scene.render.resolution_y) == size


def test_settings_that_are_kept_are_forgotten(scene: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    add(scene, results(tmp_path / "out", cloud, 0.0))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    scene = bpy.context.scene
    assert changed_words(scene) and len(hidden_things(scene)) == 3, "the notes are in the file"
    assert bpy.ops.dgs.dismiss(notice="CHANGES") == {"FINISHED"}
    assert not changed_words(scene) and scene.objects["Cube"].hide_render and scene.render.engine == "DESCATTER"
    for damaged in ("[1, 2", "[" * 100_000, "7", '{"render.engine": "CYCLES"}', '{"render.engine": [1, 2, 3]}'):
        scene.dgs.changed = damaged
        assert not changed_words(scene)
    scene.dgs.changed = '{"render.engine": [7, "CYCLES"], "nothing": [1, 2]}'
    assert bpy.ops.dgs.give_back() == {"FINISHED"} and scene.render.engine == "DESCATTER"


@pytest.mark.parametrize("case", ["chosen", "sampled", "mesh", "no engine", "hidden mesh", "light"])
def test_a_render_engine_that_somebody_has_chosen_stays(
    scene: Any, cloud: GaussianCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    """Descatter shows splats only, and needs an engine: else Cycles, which shows both, and says what it changed."""
    if case == "chosen":
        scene.render.engine = "CYCLES"
    elif case == "sampled":
        scene.eevee.taa_render_samples = 128
    elif "mesh" in case:
        bpy.ops.mesh.primitive_monkey_add()
        bpy.context.object.hide_render = case == "hidden mesh"
    elif case == "light":
        bpy.ops.object.light_add(type="SUN")
    else:
        monkeypatch.setenv("DGS_ENGINE_PYTHON", "/nowhere")
    before = settings(scene)
    add(scene, results(tmp_path / "out", cloud, 0.0))
    own = case in ("hidden mesh", "light")
    assert scene.render.engine == ("DESCATTER" if own else "CYCLES")
    assert scene.cycles.transparent_max_bounces == 256 and "transparent bounces" in changed_words(scene)
    assert scene.cycles.samples == (before["samples"] if case == "chosen" else 16), "Cycles is ready for who chooses it"
    assert ("render engine" in changed_words(scene)) is (case != "chosen")
    bpy.ops.dgs.give_back()
    assert settings(scene) == before


@pytest.mark.parametrize("touch", ["moved", "edited", "child", "linked", "animated", "hidden"])
def test_a_cube_that_somebody_uses_stays(scene: Any, cloud: GaussianCloud, tmp_path: Path, touch: str) -> None:
    cube = scene.objects["Cube"]
    if touch == "moved":
        cube.location.z = 1.0
    elif touch == "edited":
        cube.data.vertices[0].co.x = 3.0
    elif touch == "child":
        scene.objects["Light"].parent = cube
    elif touch == "linked":
        scene.collection.objects.link(bpy.data.objects.new("another", cube.data))
    elif touch == "animated":
        cube.keyframe_insert("location")
    else:
        cube.hide_render = True
    add(scene, results(tmp_path / "out", cloud, 0.0))
    assert "Cube" not in [thing.name for thing in hidden_things(scene)] and not cube.hide_get()


def ups(twin: Any) -> list[float]:
    return [camera.matrix_world.to_3x3().normalized().col[1].z for camera in cameras_of(twin)]


@pytest.mark.parametrize(
    ("tilt", "given", "upright"),
    [
        (0.3, None, True),
        (2.8, None, True),
        (0.3, "/somewhere/model", False),
        (1.5, "/somewhere/model", True),
        (1.5, "/somewhere/scene_cameras/transforms.json", False),
    ],
)
def test_it_stands_as_its_cameras_stand(
    scene: Any, cloud: GaussianCloud, tmp_path: Path, tilt: float, given: str | None, upright: bool
) -> None:
    """Structure from motion has no up; of given cameras somebody may have levelled the world."""
    twin = add(scene, results(tmp_path / "out", cloud, tilt, given))
    assert ups(twin) == pytest.approx([1.0 if upright else math.cos(tilt)] * 3, abs=1e-4)
    twin.rotation_euler.x += 0.7  # by the user: the next state stays so
    bpy.context.view_layer.update()
    leaning = ups(twin)
    add(scene, tmp_path / "out")
    assert ups(twin) == pytest.approx(leaning, abs=1e-5)


def test_the_view_sees_what_the_photo_sees(scene: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    twin = add(scene, results(tmp_path / "out", cloud, 0.4))
    twin.matrix_world = Matrix.Translation((3, 0, 1)) @ Matrix.Scale(2.0, 4) @ twin.matrix_world
    bpy.context.view_layer.update()
    pivot, turn, distance = viewpoint(twin, scene.camera, 50.0)
    eye = pivot + turn.to_matrix() @ Vector((0, 0, distance))
    # The first camera, at twice the size: 10 before the splats; the view's lens is wider by 72 / 50 to 300 / 250.
    assert (pivot - scene.camera.matrix_world.translation).length == pytest.approx(10.0, rel=0.05)
    assert turn.rotation_difference(scene.camera.matrix_world.to_quaternion()).angle < 1e-3
    assert (eye - pivot).length == pytest.approx(AIR * 10.0 * (300 / 250) / (72 / 50), rel=0.05)
    # Without cameras all of it is in view, from the front.
    pivot, turn, distance = viewpoint(twin, None, 50.0)
    assert (pivot - Vector((3, 10, 1))).length < 1.0 and 4.0 < distance < 12.0
    assert (turn.to_matrix() @ Vector((0, 0, -1)) - Vector((0, 1, 0))).length < 1e-6


def test_an_appended_twin_says_that_the_scenes_colours_are_others(
    scene: Any, cloud: GaussianCloud, tmp_path: Path
) -> None:
    twin = add(scene, results(tmp_path / "out", cloud, 0.0))
    name = twin.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "made.blend"))
    assert "colour management" not in drawn(panels.DGS_PT_twin).words
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.wm.append(directory=str(tmp_path / "made.blend" / "Object"), filename=name)
    paper = drawn(panels.DGS_PT_twin)
    assert "colour management" in paper.words.replace("\n", " ") and "dgs.prepare_scene" in paper.buttons
    view = scene.view_settings.view_transform
    assert bpy.ops.dgs.prepare_scene() == {"FINISHED"}
    assert "colour management" not in drawn(panels.DGS_PT_twin).words
    assert bpy.ops.dgs.give_back() == {"FINISHED"} and scene.view_settings.view_transform == view


def test_a_twin_leaves_with_all_that_came_with_it_and_nothing_else(
    scene: Any, cloud: GaussianCloud, tmp_path: Path
) -> None:
    before = {thing.name for thing in scene.objects}
    twin = add(scene, results(tmp_path / "out", cloud, 0.3))
    bpy.context.view_layer.objects.active = twin
    assert bpy.ops.dgs.crop_twin() == {"FINISHED"}
    mine = bpy.data.objects.new("mine", None)
    scene.collection.objects.link(mine)
    mine.parent = twin
    bpy.context.view_layer.update()
    stood = mine.matrix_world.copy()
    copy = twin.copy()
    scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = twin
    name = twin.name
    assert bpy.ops.dgs.remove_twin() == {"FINISHED"}
    assert name not in scene.objects and len(cameras_of(copy)) == 3 and len(copy.data.vertices) == 9
    bpy.context.view_layer.objects.active = copy
    assert bpy.ops.dgs.remove_twin() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert {thing.name for thing in scene.objects} == before | {"mine"}
    assert np.allclose(np.array(mine.matrix_world), np.array(stood), atol=1e-5)
    assert not [mesh for mesh in bpy.data.meshes if mesh.name != "Cube"] and len(bpy.data.cameras) == 1
    assert not scene.collection.children or "out cameras" not in scene.collection.children
