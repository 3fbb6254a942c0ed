"""Cleaning up a twin: splats are selected by what they are, deleted, hidden, brought back, merged, moved for good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import bmesh  # noqa: E402
import dgs  # noqa: E402
from dgs.core.cloud import GaussianCloud, cloud_part  # noqa: E402
from dgs.core.constants import SH_C0  # noqa: E402
from dgs.core.formats.ply import read_ply, write_ply  # noqa: E402
from dgs.dgs_addon.drawing.contents import content_of  # noqa: E402
from dgs.dgs_addon.scene.nodes import HIDDEN  # noqa: E402
from dgs.dgs_addon.scene.reading import read_flags, readable  # noqa: E402
from dgs.dgs_addon.scene.scene_cameras import PHOTO  # noqa: E402
from dgs.dgs_addon.scene.selection import read_splats  # noqa: E402
from dgs.dgs_addon.scene.sources import SOURCES  # noqa: E402
from dgs.dgs_addon.scene.twin import is_twin, read_twin  # noqa: E402
from dgs.panels.edit import DGS_PT_twin_edit  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402
from mathutils import Matrix  # noqa: E402


@pytest.fixture
def twin(cloud: GaussianCloud, tmp_path: Path) -> Iterator[Any]:
    """The twin of the nine splats, from a file, active and selected."""
    dgs.register()
    yield imported(cloud, tmp_path / "nine.ply")
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    dgs.unregister()


def imported(cloud: GaussianCloud, path: Path) -> Any:
    write_ply(path, cloud)
    assert bpy.ops.dgs.import_twin(filepath=str(path), prepare=False) == {"FINISHED"}
    bpy.context.view_layer.update()
    return bpy.context.object


def selected() -> np.ndarray:
    """Rows that are selected of the active twin."""
    return np.flatnonzero(read_splats(bpy.context.object).selected)


def pick(*rows: int) -> None:
    """Selects these splats and no others, in Edit Mode."""
    points = bmesh.from_edit_mesh(bpy.context.object.data)
    for number, point in enumerate(points.verts):
        point.select = number in rows
    bmesh.update_edit_mesh(bpy.context.object.data)


def instances() -> int:
    bpy.context.view_layer.update()
    return sum(1 for item in bpy.context.evaluated_depsgraph_get().object_instances if item.is_instance)


def test_by_size_opacity_and_colour(twin: Any, cloud: GaussianCloud, capfd: pytest.CaptureFixture[str]) -> None:
    twin.scale = (2, 2, 2)
    bpy.context.view_layer.update()
    sizes = np.exp(cloud.log_scales).max(axis=1)
    limit = float(np.median(sizes)) * 1.0001
    assert bpy.ops.dgs.select_by_size(size=2 * limit) == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH"
    np.testing.assert_array_equal(selected(), np.flatnonzero(sizes > limit))
    words = capfd.readouterr()
    assert "4 of 9 splats found, 4 selected" in words.out + words.err
    opacity = 1 / (1 + np.exp(-cloud.opacity_logits))
    bpy.ops.dgs.select_by_opacity(opacity=0.6, action="EXTEND")
    np.testing.assert_array_equal(selected(), np.flatnonzero((sizes > limit) | (opacity < 0.6)))
    colours = np.clip(cloud.sh[:, 0] * SH_C0 + 0.5, 0, 1)
    bpy.ops.dgs.select_by_colour(colour=colours[3].tolist(), tolerance=0.01, action="SUBTRACT")
    expected = (sizes > limit) | (opacity < 0.6)
    expected[3] = False
    np.testing.assert_array_equal(selected(), np.flatnonzero(expected))


def test_hidden_splats_are_never_selected(twin: Any) -> None:
    bpy.ops.dgs.edit_splats()
    pick(0, 4)
    bpy.ops.dgs.hide_splats()
    bpy.ops.dgs.select_by_size(size=0.0)
    np.testing.assert_array_equal(selected(), [1, 2, 3, 5, 6, 7, 8])


def test_by_expected_error(twin: Any, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="Suggest Next Views"):
        bpy.ops.dgs.select_by_error()
    known = np.linspace(0, 1, 9).astype(np.float32)
    np.save(tmp_path / "known.npy", known)
    pick(0, 1)
    bpy.ops.dgs.delete_splats()
    assert bpy.ops.dgs.select_by_error(error=0.7) == {"FINISHED"}
    left = known[2:]
    np.testing.assert_array_equal(selected(), np.flatnonzero(np.sqrt(1 - left) > 0.7))
    np.save(tmp_path / "known.npy", known[:4])
    with pytest.raises(RuntimeError, match="Suggest Next Views"):
        bpy.ops.dgs.select_by_error()


def test_hidden_is_hidden_everywhere_and_comes_back(twin: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    bpy.ops.dgs.edit_splats()
    pick(1, 2, 7)
    bpy.ops.mesh.hide()  # Blender's own, key H
    bpy.ops.dgs.edit_splats()
    assert bpy.context.mode == "OBJECT" and instances() == 6
    assert twin.data.attributes[HIDDEN].data[7].value
    content = content_of(twin.data, 1, 4)
    assert content is not None and content[0].count == 6
    kept = [0, 3, 4, 5, 6, 8]
    np.testing.assert_array_equal(content[0].planes(memoryview(content[1]))[0], cloud.means[kept])
    out = str(tmp_path / "out.ply")
    bpy.ops.dgs.export_twin(filepath=out, only_shown=True)
    np.testing.assert_array_equal(read_ply(Path(out)).means, cloud.means[kept])
    bpy.ops.dgs.export_twin(filepath=out)
    assert len(read_ply(Path(out))) == 9
    bpy.ops.dgs.edit_splats()
    bpy.ops.dgs.export_twin(filepath=out, only_shown=True)  # in Edit Mode, too
    assert len(read_ply(Path(out))) == 6
    bpy.ops.dgs.show_splats()
    np.testing.assert_array_equal(selected(), [1, 2, 7])
    bpy.ops.dgs.edit_splats()
    assert instances() == 9


def test_what_is_selected_is_tinted_for_the_picture(twin: Any, cloud: GaussianCloud) -> None:
    bpy.ops.dgs.edit_splats()
    pick(3)
    with readable(twin) as mesh:
        content = content_of(mesh, 1, 4, tinted=True)
        assert read_flags(mesh, "select")[3]
    assert content is not None
    base = content[0].planes(memoryview(content[1]))[3][:, :3] * SH_C0 + 0.5
    own = cloud.sh[:, 0] * SH_C0 + 0.5
    np.testing.assert_allclose(np.delete(base, 3, 0), np.delete(own, 3, 0), atol=1e-6)
    assert np.abs(base[3] - [1.0, 0.47, 0.05]).max() < 0.36 * np.abs(own[3] - [1.0, 0.47, 0.05]).max()


def test_deleted_splats_come_back_as_they_were(
    twin: Any, cloud: GaussianCloud, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    before = read_twin(twin)
    bpy.ops.dgs.edit_splats()
    pick(0, 5, 8)
    assert bpy.ops.dgs.delete_splats() == {"FINISHED"}
    assert "3 splats deleted" in (said := capfd.readouterr()).out + said.err
    assert bpy.ops.dgs.restore_splats() == {"FINISHED"}
    assert "3 splats are back" in (said := capfd.readouterr()).out + said.err
    bpy.ops.object.mode_set(mode="OBJECT")
    order = [1, 2, 3, 4, 6, 7, 0, 5, 8]
    after = read_twin(twin)
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[order])
    assert bpy.ops.dgs.restore_splats() == {"CANCELLED"}
    write_ply(tmp_path / "nine.ply", cloud_part(cloud, np.arange(8)))
    with pytest.raises(RuntimeError, match="has changed since"):
        bpy.ops.dgs.restore_splats()
    (tmp_path / "nine.ply").unlink()
    with pytest.raises(RuntimeError, match="nine"):
        bpy.ops.dgs.restore_splats()


@pytest.mark.parametrize("damage", ["", "[", "[1]", '[{"file": 3}]', "[" * 9999, '[{"file":"a","count":1}]'])
def test_damaged_sources_are_said(twin: Any, damage: str) -> None:
    twin.data[SOURCES] = damage
    with pytest.raises(RuntimeError, match="import it again"):
        bpy.ops.dgs.restore_splats()


def test_floaters_are_selected(cloud: GaussianCloud, twin: Any, tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    body = random.normal(size=(1500, 3))
    body /= np.linalg.norm(body, axis=1, keepdims=True)
    clump = np.array([3.0, 0, 0]) + random.normal(size=(20, 3)) * 0.02
    alone = np.array([[0.0, -2.5, 0], [0, 2.5, 0.5]])
    means = np.concatenate([body, clump, alone]).astype(np.float32)
    count = len(means)
    whole = GaussianCloud(
        means,
        np.full((count, 3), np.log(0.05), np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full(count, 2.0, np.float32),
        random.normal(size=(count, 1, 3)).astype(np.float32),
    )
    ball = imported(whole, tmp_path / "ball.ply")
    assert bpy.ops.dgs.select_floaters() == {"FINISHED"}
    np.testing.assert_array_equal(selected(), np.arange(1500, count))
    bpy.ops.dgs.select_floaters(island=15)
    np.testing.assert_array_equal(selected(), [count - 2, count - 1])
    bpy.ops.object.mode_set(mode="OBJECT")
    for number in range(3):  # the lower edge of two photos' frames cuts the ball in the middle, the upper edge of one
        eye = bpy.data.objects.new(f"eye {number}", bpy.data.cameras.new("eye"))
        bpy.context.scene.collection.objects.link(eye)
        eye[PHOTO] = f"{number}.png"
        eye.parent = ball
        up = 1 if number < 2 else -1
        eye.matrix_world = Matrix.Translation((0, -30, 15.0 * up)) @ Matrix.Rotation(np.pi / 2, 4, "X")
        eye.data.angle_y = 2 * np.arctan(0.5)
        eye.data.sensor_fit = "VERTICAL"
    bpy.context.view_layer.update()
    bpy.ops.dgs.select_floaters(island=0, weighed=False)
    height, depth = -means[:, 1], 30 + means[:, 2]
    seen = 2 * (height >= 15 - depth / 2) + (height <= depth / 2 - 15)
    np.testing.assert_array_equal(selected(), np.flatnonzero(seen < 2))
    deleted = len(selected())
    bpy.ops.dgs.delete_splats()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(ball.data.vertices) == count - deleted


def test_a_transform_becomes_part_of_the_splats(twin: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    turn = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.9, 4, (0.3, -0.5, 0.8)) @ Matrix.Scale(2.5, 4)
    twin.matrix_world = turn @ twin.matrix_world
    child = bpy.data.objects.new("child", None)
    bpy.context.scene.collection.objects.link(child)
    child.parent, child.location = twin, (1, 0, 0)
    bpy.context.view_layer.update()
    stood = np.array(child.matrix_world)
    bpy.ops.dgs.export_twin(filepath=str(tmp_path / "placed.ply"), placed=True)
    assert bpy.ops.dgs.apply_transform() == {"FINISHED"}
    bpy.context.view_layer.update()
    np.testing.assert_allclose(np.array(child.matrix_world), stood, atol=1e-5)
    bpy.ops.dgs.export_twin(filepath=str(tmp_path / "left.ply"))
    placed, left = read_ply(tmp_path / "placed.ply"), read_ply(tmp_path / "left.ply")
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_allclose(getattr(left, name), getattr(placed, name), atol=1e-5)
    bpy.ops.dgs.edit_splats()
    pick(2)
    bpy.ops.dgs.delete_splats()
    bpy.ops.dgs.restore_splats()
    bpy.ops.dgs.edit_splats()
    np.testing.assert_allclose(read_twin(twin).means[8], placed.means[2], atol=1e-5)


def test_a_mirrored_twin_is_refused(twin: Any) -> None:
    twin.scale = (-1, 1, 1)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="mirrored"):
        bpy.ops.dgs.apply_transform()


def test_two_twins_become_one(twin: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    plain = replace(cloud, sh=cloud.sh[:, :1], means=cloud.means + np.float32(10))
    other = imported(plain, tmp_path / "plain.ply")
    other.matrix_world = Matrix.Translation((4, 0, 0)) @ Matrix.Scale(0.5, 4) @ other.matrix_world
    duplicate = other.copy()
    bpy.context.scene.collection.objects.link(duplicate)
    duplicate.name = "stays"
    duplicate.select_set(False)
    twin.matrix_world = Matrix.Rotation(0.5, 4, "Z") @ twin.matrix_world
    bpy.context.view_layer.update()
    bpy.ops.dgs.export_twin(filepath=str(tmp_path / "second.ply"), placed=True)
    bpy.context.view_layer.objects.active = other
    bpy.ops.dgs.edit_splats()
    pick(4)
    bpy.ops.dgs.hide_splats()
    bpy.ops.dgs.edit_splats()
    twin.select_set(True)
    bpy.context.view_layer.objects.active = twin
    assert bpy.ops.dgs.merge_twins() == {"FINISHED"}
    assert [thing.name for thing in bpy.data.objects if is_twin(thing)] == ["nine", "stays"]
    assert len(duplicate.data.vertices) == 9
    np.testing.assert_array_equal(np.flatnonzero(read_flags(twin.data, "hide")), [13])
    bpy.ops.dgs.export_twin(filepath=str(tmp_path / "both.ply"), placed=True)
    both, second = read_ply(tmp_path / "both.ply"), read_ply(tmp_path / "second.ply")
    assert both.sh.shape == (18, 4, 3)
    np.testing.assert_allclose(both.means[9:], second.means, atol=1e-4)
    np.testing.assert_allclose(both.log_scales[9:], second.log_scales, atol=1e-5)
    bpy.ops.dgs.edit_splats()
    bpy.ops.dgs.select_by_size(size=0.0)
    bpy.ops.dgs.delete_splats()
    assert bpy.ops.dgs.restore_splats() == {"FINISHED"}
    bpy.ops.dgs.edit_splats()
    assert bpy.context.mode == "OBJECT"
    bpy.ops.dgs.export_twin(filepath=str(tmp_path / "back.ply"), placed=True)
    back = read_ply(tmp_path / "back.ply")
    order = np.argsort(both.means[:, 0]), np.argsort(back.means[:, 0])
    np.testing.assert_allclose(back.means[order[1]], both.means[order[0]], atol=1e-4)


def test_the_panel_says_what_is_selected(twin: Any) -> None:
    in_object = drawn(DGS_PT_twin_edit, object=twin, mode="OBJECT")
    assert in_object.buttons["dgs.edit_splats"][0].text == "Edit Splats" and "are selected" not in in_object.words
    bpy.ops.dgs.edit_splats()
    pick(1, 2)
    in_edit = drawn(DGS_PT_twin_edit, object=twin, mode="EDIT_MESH", objects_in_mode_unique_data=[twin])
    assert in_edit.buttons["dgs.edit_splats"][0].text == "Back to Object Mode"
    assert "2 splats are selected" in in_edit.words
