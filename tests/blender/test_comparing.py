"""A twin compared with an earlier one in Blender: the coloured mesh where the twin stands, and what the panel says."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import panels  # noqa: E402
from dgs.core.change.motion import rotation_of  # noqa: E402
from dgs.core.errors import FormatError  # noqa: E402
from dgs.core.formats.meshes import write_mesh  # noqa: E402
from dgs.core.triangles import Mesh  # noqa: E402
from dgs.dgs_addon.job import runner  # noqa: E402
from dgs.dgs_addon.job.request import change_request  # noqa: E402
from dgs.dgs_addon.job.results import add_twin_of  # noqa: E402
from dgs.dgs_addon.scene.comparison import KINDS, add_changes, changed_mesh, changes_of, line_of  # noqa: E402
from dgs.dgs_addon.scene.measures import add_measure, from_file, given_place  # noqa: E402
from dgs.dgs_addon.translations import table  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402
from dgs.tests.core.change.scene import AWAY, BLOCK, KNOB, PX, Scene, write_scene  # noqa: E402


@pytest.fixture(scope="module")
def weeks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """week1/twin and week2/twin: the block has come out, the knob is gone."""
    place = tmp_path_factory.mktemp("weeks")
    write_scene(place / "week1", Scene())
    write_scene(place / "week2", Scene(seed=1, out=1.5, knob=False))
    return place


@pytest.fixture
def twin(weeks: Path, tmp_path: Path) -> Iterator[Any]:
    """Of the second week, moved and enlarged."""
    shutil.copytree(weeks, tmp_path, dirs_exist_ok=True)
    dgs.register()
    bpy.context.scene.dgs.threads = 1
    found = add_twin_of(tmp_path / "week2" / "twin", bpy.context.scene)
    found.scale, found.location = (2.0, 2.0, 2.0), (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    yield found
    dgs.unregister()


def in_blender(twin: Any, *place: float) -> np.ndarray:
    """A place of the twin's file in Blender's world."""
    return (from_file(twin) @ [*place, 1.0])[:3]


def corners_of(thing: Any, material: str = "") -> np.ndarray:
    """[N, 3] in Blender's world: of all faces, or of those with a material."""
    bpy.context.view_layer.update()
    names = [slot.material.name for slot in thing.material_slots]
    faces = [face for face in thing.data.polygons if material in names[face.material_index]]
    return np.array([thing.matrix_world @ thing.data.vertices[at].co for face in faces for at in face.vertices])


def test_what_has_changed_lies_coloured_where_the_twin_stands_and_is_listed(twin: Any, tmp_path: Path) -> None:
    """In mm, for a length of the twin is known: a unit of its file is 100 mm."""
    ends = [given_place(twin, in_blender(twin, x, -0.7, AWAY)) for x in (-0.9, 0.9)]
    held = twin.dgs_measures
    add_measure(twin, "length", ends, "edge").known = True
    held.length, held.deviation, held.unit = 180.0, 1.0, "mm"
    assert bpy.ops.dgs.compare_earlier(directory=str(tmp_path / "week1" / "twin")) == {"FINISHED"}
    mesh = changed_mesh(twin)
    assert mesh.parent == twin and mesh.name == f"{twin.name} changes" and len(mesh.data.color_attributes) == 1
    gone, moved = corners_of(mesh, "Vanished"), corners_of(mesh, "Moved")
    assert np.allclose(gone.mean(axis=0), in_blender(twin, *KNOB, AWAY - 8 * PX), atol=0.15)
    assert np.allclose(moved.mean(axis=0), in_blender(twin, *BLOCK, AWAY - 4 * PX), atol=0.15)
    red = next(slot.material for slot in mesh.material_slots if "Vanished" in slot.material.name)
    assert red.diffuse_color[0] > 0.6 > 0.1 > red.diffuse_color[1], "solid views show the material's colour"
    kinds = {region["kind"]: region for region in changes_of(twin)["regions"]}
    assert set(kinds) == {"moved", "vanished"} and kinds["vanished"]["unit"] == "mm"
    assert kinds["vanished"]["low"] < 8 * PX * 100 < kinds["vanished"]["high"]
    words = drawn(panels.DGS_PT_twin_measure, 640).words
    assert "Since week1/twin" in words and "Gone: stood out by" in words and "Moved by" in words and "mm" in words
    assert twin.hide_get() and not mesh.hide_get()
    assert bpy.ops.dgs.show_changes() == {"FINISHED"} and mesh.hide_get() and not twin.hide_get()
    assert bpy.ops.dgs.show_changes() == {"FINISHED"} and not mesh.hide_render and twin.hide_render
    assert bpy.ops.dgs.remove_twin() == {"FINISHED"} and not any(thing.type == "MESH" for thing in bpy.data.objects)


def result(place: Path, *kinds: str, scale: float = 1.0) -> Path:
    """What the command writes: a square of the first world, red, one corner of it grey; turned against the second."""
    colours = {name: [214, 39, 40] for name in ("vanished", "appeared", "repainted")} | {"unseen": [225, 205, 160]}
    regions = [{"kind": kind, "value": 1.34, "low": 1.2, "high": 1.48, "unit": "px-equivalent"} for kind in kinds]
    rotation = rotation_of(np.array([0.3, 1.0, -2.0]))
    world = {"scale": scale, "rotation": rotation.tolist(), "translation": [1.0, 2.0, 3.0]}
    content = {"regions": regions, "surface": {"places": 100, "held": 80}, "alignment": world}
    place.mkdir(exist_ok=True)
    content["colours"] = {**colours, "moved": {"bar": [[68, 1, 84], [253, 231, 37]]}}
    (place / "change.json").write_text(json.dumps(content))
    second = np.array([[0, 0, AWAY], [1, 0, AWAY], [1, 1, AWAY], [0, 1, AWAY]], float)
    shades = np.array([[214, 39, 40]] * 3 + [[230, 230, 230]], np.uint8)
    at = scale * second @ rotation.T + [1.0, 2.0, 3.0]
    write_mesh(place / "change.glb", Mesh(at, np.array([[0, 1, 2], [0, 2, 3]]), shades))
    return place


def test_another_world_is_brought_into_the_twins(twin: Any, tmp_path: Path) -> None:
    thing = add_changes(twin, result(tmp_path / "a", "grew", scale=40.0), "week1", bpy.context.scene)
    assert np.allclose(corners_of(thing)[1], in_blender(twin, 1, 0, AWAY), atol=1e-4)
    assert [slot.material.name for slot in thing.material_slots] == ["Descatter Change: Vanished"]
    twin.location = (0.0, 0.0, 0.0)
    assert np.allclose(corners_of(thing)[1], in_blender(twin, 1, 0, AWAY), atol=1e-4), "it goes where the twin goes"
    again = add_changes(twin, result(tmp_path / "a", "grew", scale=0.1), "week1", bpy.context.scene)
    assert changed_mesh(twin) == again and sum("changes" in one.name for one in twin.children) == 1


def test_the_panel_says_what_has_changed_or_that_nothing_has(twin: Any, tmp_path: Path) -> None:
    add_changes(twin, result(tmp_path / "a", *KINDS, *["grew"] * 10), "week 1", bpy.context.scene)
    words = drawn(panels.DGS_PT_twin_measure, 900).words
    assert "Since week 1" in words and "Wider by 1.34 px (1.20 to 1.48)" in words and "px-equivalents" in words
    assert "And 4 smaller ones" in words and "80 of 100 places" in words
    add_changes(twin, result(tmp_path / "a"), "week 1", bpy.context.scene)
    words = drawn(panels.DGS_PT_twin_measure, 900).words
    assert "Nothing has changed beyond chance" in words and "Wider" not in words
    twin["dgs_changes"] = "{"
    assert "Since" not in drawn(panels.DGS_PT_twin_measure).words


def test_all_kinds_have_german_words_and_icons_that_are_there() -> None:
    icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
    for words, icon in KINDS.values():
        assert words in table("de_DE") and icon in icons
    assert line_of({"kind": "repainted", "value": None, "low": None, "high": None, "unit": "mm"})[2] == {}


@pytest.mark.parametrize(("name", "content"), [("change.json", "{}"), ("change.glb", "glTF"), ("change.json", None)])
def test_damaged_results_are_named_and_leave_the_scene_alone(
    twin: Any, tmp_path: Path, name: str, content: str | None
) -> None:
    folder = result(tmp_path / "a", "grew")
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_text(content)
    with pytest.raises(FormatError, match=name):
        add_changes(twin, folder, "week1", bpy.context.scene)
    assert changed_mesh(twin) is None and changes_of(twin) is None and not twin.hide_get()


def test_what_is_no_earlier_twin_is_refused_with_the_way_out(twin: Any, tmp_path: Path) -> None:
    for folder, why in (
        ("", "Choose the folder of its results"),
        (str(tmp_path), "There is no twin in"),
        (str(tmp_path / "week2" / "twin"), "this very twin"),
    ):
        with pytest.raises(RuntimeError, match=why):
            bpy.ops.dgs.compare_earlier(directory=folder)
    photos = tmp_path / "week1" / "twin" / "photos.txt"
    photos.write_text(photos.read_text("utf-8").replace("week1", "nowhere"), "utf-8")
    with pytest.raises(RuntimeError, match="view_00.png"):
        bpy.ops.dgs.compare_earlier(directory=str(tmp_path / "week1" / "twin"))
    paper = drawn(panels.DGS_PT_main, 900)
    assert "view_00.png" in paper.words and "dgs.show_log" in paper.buttons
    assert bpy.ops.dgs.show_log() == {"FINISHED"}
    assert "view_00.png" in bpy.data.texts["Descatter Log"].as_string()


def test_a_cancelled_comparison_leaves_the_scene_as_it_was(twin: Any, tmp_path: Path) -> None:
    folders = tmp_path / "week2" / "twin", tmp_path / "week1" / "twin"
    scene = bpy.context.scene
    job = runner.start(change_request(scene.dgs, twin, *folders), Path(sys.executable), scene)
    assert not bpy.ops.dgs.compare_earlier.poll() and drawn(panels.DGS_PT_main).bars == ["Starting the engine"]
    runner.cancel()
    assert runner.wait(60.0) and job.state.phase == "cancelled"
    assert changed_mesh(twin) is None and not twin.hide_get()


def test_files_of_others_are_left_alone(twin: Any, tmp_path: Path) -> None:
    folders = tmp_path / "week2" / "twin", tmp_path / "week1" / "twin"
    (folders[0] / "change").mkdir()
    (folders[0] / "change" / "change.csv").write_text("mine")
    request = change_request(bpy.context.scene.dgs, twin, *folders)
    assert request.out == folders[0] / "change-2" and "--measures-after" not in request.arguments
