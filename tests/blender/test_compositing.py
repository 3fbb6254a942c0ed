"""Final pictures of a twin among meshes: Descatter and Cycles, put together by depth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.dgs_addon.axes import place_camera  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.changes import changed_words  # noqa: E402
from dgs.dgs_addon.scene.compositing import GROUP, twins_scene  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from dgs.tests.core.serving.test_pictures import crowd  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_picture_server")
CAMERA = Camera("view", 120, 90, 130.0, 130.0, 60.0, 45.0, np.eye(3), np.array([0.1, 0.0, 0.2]))


@pytest.fixture
def scene() -> Iterator[Any]:
    """A twin 3.7 to 6.3 before the camera, with a camera and nothing else."""
    dgs.register()
    scene = bpy.context.scene
    scene.view_settings.view_transform, scene.render.dither_intensity = "Standard", 0.0
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    place_camera(new_camera("view", scene), CAMERA, scene.render)
    add_twin(crowd(), "twin", scene.collection)
    yield scene
    dgs.unregister()


def wall(colour: tuple[float, float, float], away: float, width: float = 4.0) -> Any:
    """A shining wall that faces the camera."""
    bpy.ops.mesh.primitive_plane_add(size=width, location=(0.0, away, 0.0), rotation=(np.pi / 2, 0.0, 0.0))
    material = bpy.data.materials.new("shining")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    light = nodes.new("ShaderNodeEmission")
    light.inputs[0].default_value = (*colour, 1.0)
    material.node_tree.links.new(light.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs[0])
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def rendered(scene: Any, path: Path) -> np.ndarray:
    """[H, W, 4] 8 bit as int."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return np.asarray(Image.open(path)).astype(int)


def alone(scene: Any, path: Path) -> np.ndarray:
    """The twin without anything else, over nothing."""
    scene.render.engine, scene.render.film_transparent = "DESCATTER", True
    return rendered(scene, path)


def test_a_twin_lies_before_and_behind_meshes(scene: Any, tmp_path: Path) -> None:
    twin = alone(scene, tmp_path / "alone.png")
    back = wall((0.0, 1.0, 0.0), 9.0, 30.0)
    assert bpy.ops.dgs.composite_meshes(meshes="CYCLES") == {"FINISHED"}
    assert scene.render.engine == "CYCLES" and twins_scene(scene).render.engine == "DESCATTER"
    assert "render engine" in changed_words(scene)
    seen = rendered(scene, tmp_path / "behind.png")
    solid, nothing = twin[..., 3] == 255, twin[..., 3] == 0
    assert np.abs(seen - twin)[solid].max() <= 2, "the wall is behind it"
    assert (seen[nothing] == (0, 255, 0, 255)).all()
    half = (twin[..., 3] > 60) & (twin[..., 3] < 200)
    assert (seen[half][:, 3] == 255).all() and (seen[half][:, 1] > twin[half][:, 1] * twin[half][:, 3] // 255).all()
    back.location.y = 2.0
    before = rendered(scene, tmp_path / "before.png")
    assert (before == (0, 255, 0, 255)).all(), "the wall is before it"
    back.location.y, back.scale = 4.2, (0.04, 0.04, 0.04)  # among the splats
    among = rendered(scene, tmp_path / "among.png")
    inside = np.zeros(twin.shape[:2], bool)
    inside[20:70, 40:90] = True
    green = (among == (0, 255, 0, 255)).all(axis=2)
    assert 0.05 < green[inside].mean() < 0.5, "some of the splats are before it, some behind"
    assert np.abs(among - twin)[~inside].max() <= 2


@pytest.mark.parametrize("by_collection", [False, True])
def test_a_holdout_holds_out_what_is_behind_it(scene: Any, tmp_path: Path, by_collection: bool) -> None:
    """The twin, the mesh behind it and the holdout, which is behind, before and among the splats."""
    twin = alone(scene, tmp_path / "alone.png")
    wall((0.0, 1.0, 0.0), 9.0, 30.0)
    hole = wall((1.0, 0.0, 0.0), 8.0, 5.0)
    if by_collection:
        inner = bpy.data.collections.new("held out")
        scene.collection.children.link(inner)
        inner.objects.link(hole)
        scene.collection.objects.unlink(hole)
        scene.view_layers[0].layer_collection.children["held out"].holdout = True
    else:
        hole.is_holdout = True
    bpy.ops.dgs.composite_meshes()
    behind = rendered(scene, tmp_path / "behind.png")
    solid, nothing = twin[..., 3] == 255, twin[..., 3] == 0
    assert np.abs(behind - twin)[solid].max() <= 2, "the twin is before it"
    assert (behind[nothing] == (0, 255, 0, 255)).all()
    soft = (twin[..., 3] > 60) & (twin[..., 3] < 200)
    held = np.abs(behind - twin)[soft].max(axis=1) <= 2
    assert 0.1 < held.mean() < 0.9, "nothing is behind it where the wall is held out"
    assert (behind[soft][~held][:, 3] > twin[soft][~held][:, 3]).all()
    hole.location.y = 2.0
    assert not rendered(scene, tmp_path / "before.png").any(), "it is before all"
    hole.location.y, hole.scale = 4.2, (0.15, 0.15, 0.15)
    among = rendered(scene, tmp_path / "among.png")
    away = np.abs(among - twin)[solid].max(axis=1)
    cut = (among[solid] == 0).all(axis=1)
    assert 0.01 < cut.mean() < 0.7, "some of the splats are before it, some behind"
    assert (away[~cut] > 2).mean() < 0.05, "but for its edges, which Cycles smooths"


def test_a_holdout_cuts_final_pictures_of_twins_alone(scene: Any, tmp_path: Path) -> None:
    whole = alone(scene, tmp_path / "alone.png")
    hole = wall((1.0, 0.0, 0.0), 2.0, 0.5)
    assert np.array_equal(alone(scene, tmp_path / "mesh.png"), whole), "meshes are not rendered"
    hole.is_holdout = True
    cut = alone(scene, tmp_path / "cut.png")
    gone = (cut == 0).all(axis=2) & (whole[..., 3] > 0)
    assert gone.any() and np.array_equal(cut[~gone], whole[~gone])
    scene.render.film_transparent = False
    scene.render.engine = "DESCATTER"
    opaque = rendered(scene, tmp_path / "opaque.png")
    assert (opaque[gone][:, 3] == 0).all() and (opaque[2, 2] == (0, 0, 0, 255)).all()


def test_views_keep_the_twin_and_only_renders_leave_it_out(scene: Any, tmp_path: Path) -> None:
    twin = next(thing for thing in scene.objects if "dgs_harmonics" in thing)
    wall((0.0, 1.0, 0.0), 9.0)
    for _ in range(2):  # pressed again it changes nothing
        assert bpy.ops.dgs.composite_meshes() == {"FINISHED"}
        bpy.context.view_layer.update()
        assert twin.visible_get() and not twin.hide_render and twin.name in twins_scene(scene).objects
        assert len([s for s in bpy.data.scenes if s.get("dgs_twins_of")]) == 1
        tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
        assert len([node for node in tree.nodes if node.label == GROUP]) == 1
    another = add_twin(crowd(50), "another", scene.collection)
    assert another.name not in twins_scene(scene).objects
    bpy.ops.dgs.composite_meshes()
    assert set(twins_scene(scene).collection.objects) == {twin, another}
    assert set(twin.users_collection) == set(another.users_collection)
    bpy.context.view_layer.objects.active, name = another, another.name
    assert bpy.ops.dgs.remove_twin() == {"FINISHED"} and name not in bpy.data.objects
    assert set(twins_scene(scene).collection.objects) == {twin}
    before = rendered(scene, tmp_path / "a.png")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "made.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "made.blend"))
    assert np.array_equal(rendered(bpy.context.scene, tmp_path / "b.png"), before)


def test_what_the_user_has_in_the_compositor_stays(scene: Any, tmp_path: Path) -> None:
    """Behind the group, where it is fed by the group now."""
    if hasattr(scene, "compositing_node_group"):
        tree = scene.compositing_node_group = bpy.data.node_groups.new("mine", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        output = tree.nodes.new("NodeGroupOutput")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        output = tree.nodes.new("CompositorNodeComposite")
    layers, invert = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeInvert")
    place = next(i for i, socket in enumerate(invert.inputs) if socket.type == "RGBA")
    tree.links.new(layers.outputs["Image"], invert.inputs[place])
    tree.links.new(invert.outputs[0], output.inputs[0])
    wall((0.0, 1.0, 0.0), 9.0, 30.0)
    bpy.ops.dgs.composite_meshes()
    assert invert.inputs[place].links[0].from_node.label == GROUP
    assert output.inputs[0].links[0].from_node == invert
    assert (rendered(scene, tmp_path / "a.png")[2, 2] == (255, 0, 255, 255)).all()
