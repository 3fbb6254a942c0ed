"""Twins in a scene: attributes, the import operator, .blend files."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.errors import FormatError  # noqa: E402
from dgs.core.formats.colmap import write_model  # noqa: E402
from dgs.core.formats.ply import read_ply, write_ply  # noqa: E402
from dgs.core.views import SparsePoints  # noqa: E402
from dgs.dgs_addon.axes import points_to_blender  # noqa: E402
from dgs.dgs_addon.scene.crop import add_crop_box, crop_box  # noqa: E402
from dgs.dgs_addon.scene.nodes import CROP_INPUT, THRESHOLD_INPUT, VIEWPORT_INPUT, set_splat_input, splat_modifier  # noqa: E402
from dgs.dgs_addon.scene.points import add_points  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin, is_twin, read_twin  # noqa: E402
from mathutils import Matrix  # noqa: E402


@pytest.fixture
def registered() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


def _instances(twin: object) -> int:
    graph = bpy.context.evaluated_depsgraph_get()
    return sum(1 for item in graph.object_instances if item.is_instance)


def test_attributes_come_back_as_they_went_in(cloud: GaussianCloud) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    back = read_twin(twin)
    unit = cloud.quaternions / np.linalg.norm(cloud.quaternions, axis=1, keepdims=True)
    np.testing.assert_array_equal(back.means, cloud.means)
    np.testing.assert_array_equal(back.sh, cloud.sh)
    np.testing.assert_allclose(back.log_scales, cloud.log_scales, atol=1e-6)
    np.testing.assert_allclose(back.opacity_logits, cloud.opacity_logits, atol=1e-5)
    np.testing.assert_allclose(back.quaternions, unit, atol=1e-6)


def test_attributes_are_named_as_native_splats(cloud: GaussianCloud) -> None:
    attributes = add_twin(cloud, "twin", bpy.context.scene.collection).data.attributes
    expected = {"position", "scale", "rotation", "radiance:base", "radiance:sh_0", "radiance:sh_1", "radiance:sh_2"}
    assert expected <= set(attributes.keys())
    np.testing.assert_allclose(attributes["scale"].data[0].vector, np.exp(cloud.log_scales[0]), rtol=1e-6)
    opacity = 1 / (1 + np.exp(-cloud.opacity_logits[0]))
    assert attributes["radiance:base"].data[0].color[3] == pytest.approx(opacity, abs=1e-6)


def test_the_object_stands_in_blenders_axes(cloud: GaussianCloud) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    places = [np.array(i.matrix_world.translation) for i in graph.object_instances if i.is_instance]
    assert len(places) == len(cloud)
    np.testing.assert_allclose(places, points_to_blender(cloud.means), atol=1e-5)
    assert is_twin(twin)


def test_controls_reduce_what_is_shown(cloud: GaussianCloud) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    bpy.context.view_layer.update()
    assert _instances(twin) == 9
    modifier = splat_modifier(twin)
    set_splat_input(modifier, VIEWPORT_INPUT, 4)
    bpy.context.view_layer.update()
    assert _instances(twin) == 4
    set_splat_input(modifier, THRESHOLD_INPUT, 1.0)
    bpy.context.view_layer.update()
    assert _instances(twin) == 0


def test_a_box_limits_what_is_shown_wherever_both_are(cloud: GaussianCloud) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    twin.matrix_world = Matrix.Translation((3, -1, 2)) @ Matrix.Rotation(0.8, 4, "Y") @ twin.matrix_world
    twin.scale *= 2.5
    box = add_crop_box(twin, bpy.context.scene.collection)
    assert crop_box(twin) == box
    bpy.context.view_layer.update()
    assert 1 <= _instances(twin) <= 9
    # A turned box around the middle column, in the world: the same splats as numpy finds inside.
    box.parent = None
    turn = Matrix.Translation((0, 0, 5)) @ Matrix.Rotation(0.3, 4, "Z")
    box.matrix_world = twin.matrix_world @ turn @ Matrix.Diagonal((0.7, 9, 9, 1))
    bpy.context.view_layer.update()
    to_box = np.array(box.matrix_world.inverted() @ twin.matrix_world)
    inside = (np.abs(cloud.means @ to_box[:3, :3].T + to_box[:3, 3]) <= 1).all(axis=1)
    assert 0 < inside.sum() < 9
    twin.update_tag()
    bpy.context.view_layer.update()
    assert _instances(twin) == inside.sum()
    set_splat_input(splat_modifier(twin), CROP_INPUT, False)
    bpy.context.view_layer.update()
    assert _instances(twin) == 9


def test_points_of_a_model_are_shown_in_their_colours(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap")
    points = SparsePoints(np.array([[1.0, 2, 3], [4, 5, 6]]), np.array([[255, 0, 0], [10, 200, 128]], np.uint8))
    camera = Camera("a.png", 64, 48, 50, 50, 32, 24, np.eye(3), np.zeros(3))
    write_model(tmp_path, {"a.png": camera}, points)
    thing = add_points(tmp_path, "points", bpy.context.scene.collection)
    bpy.context.view_layer.update()
    np.testing.assert_allclose([tuple(v.co) for v in thing.data.vertices], points_to_blender(points.positions))
    colour = thing.data.attributes["colour"].data[1].color_srgb
    np.testing.assert_allclose(np.array(colour[:3]) * 255, points.colours[1], atol=0.6)
    graph = bpy.context.evaluated_depsgraph_get()
    shown = thing.evaluated_get(graph)
    if hasattr(shown, "evaluated_geometry"):  # not in Blender 4.2
        assert len(shown.evaluated_geometry().pointcloud.points) == 2
    assert thing.hide_render
    write_model(tmp_path, {"a.png": camera}, SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8)))
    assert add_points(tmp_path, "points", bpy.context.scene.collection) is None


def test_values_that_are_not_finite_are_left_out(cloud: GaussianCloud) -> None:
    cloud.means[2, 1] = np.nan
    assert len(add_twin(cloud, "twin", bpy.context.scene.collection).data.vertices) == 8
    cloud.sh[:] = np.inf
    with pytest.raises(FormatError, match="twin"):
        add_twin(cloud, "twin", bpy.context.scene.collection)


def test_a_million_splats_in_two_seconds(tmp_path: Path) -> None:
    """From the file to the object."""
    count = 1_000_000
    generator = np.random.default_rng(0)
    many = GaussianCloud(
        generator.random((count, 3), np.float32),
        np.full((count, 3), -6, np.float32),
        generator.random((count, 4), np.float32),
        np.zeros(count, np.float32),
        generator.random((count, 1, 3), np.float32),
    )
    write_ply(tmp_path / "many.ply", many)
    started = time.thread_time()
    add_twin(read_ply(tmp_path / "many.ply"), "many", bpy.context.scene.collection)
    spent = time.thread_time() - started
    print(f"a million Gaussians from a PLY: {spent:.2f} s")
    assert spent < 2.0


def test_the_operator_imports_and_prepares(cloud: GaussianCloud, tmp_path: Path, registered: None) -> None:
    path = tmp_path / "ball of splats.ply"
    write_ply(path, cloud)
    assert bpy.ops.dgs.import_twin(filepath=str(path)) == {"FINISHED"}
    twin = bpy.context.view_layer.objects.active
    assert is_twin(twin) and twin.name == "ball of splats"
    assert bpy.context.scene.render.engine == "DESCATTER"
    assert bpy.context.scene.view_settings.view_transform == "Standard"


def test_the_operator_explains_a_wrong_file(tmp_path: Path, registered: None) -> None:
    path = tmp_path / "no.ply"
    path.write_text("this is no PLY")
    with pytest.raises(RuntimeError, match=r"no\.ply"):
        bpy.ops.dgs.import_twin(filepath=str(path))
    assert not bpy.data.objects


def test_a_blend_file_from_the_command_line(cloud: GaussianCloud, tmp_path: Path) -> None:
    write_ply(tmp_path / "twin.ply", cloud)
    out = tmp_path / "folder" / "twin.blend"
    command = [sys.executable, str(Path(dgs.__path__[0]) / "run_dgs.py"), "blend", str(tmp_path / "twin.ply")]
    subprocess.run([*command, "--out", str(out)], check=True, capture_output=True)
    bpy.ops.wm.open_mainfile(filepath=str(out))
    assert is_twin(bpy.data.objects["twin"]) and bpy.context.scene.camera is not None
    assert "Descatter Splat" in bpy.data.materials
    assert bpy.context.scene.view_settings.view_transform == "Raw"


def test_the_renderers_own_lines_stay_off_the_terminal(tmp_path: Path) -> None:
    """What Cycles says of missing graphics cards would stand between progress bars."""
    words = ["synthesize", "--out", str(tmp_path / "set"), "--views", "2", "--size", "32x24", "--samples", "1"]
    words += ["--no-denoise", "--psf", "gaussian:1", "--overscan", "6", "--progress", "none"]
    command = [sys.executable, str(Path(dgs.__path__[0]) / "run_dgs.py"), *words]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout == done.stderr == ""
