"""Textured meshes in Blender: as its importers read the files, and as "Make Mesh" puts them beside the twin."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.formats.meshes import write_mesh  # noqa: E402
from dgs.core.triangles import Mesh, Texture  # noqa: E402
from dgs.dgs_addon.job.results import add_twin_of  # noqa: E402
from dgs.dgs_addon.scene.measures import from_file  # noqa: E402
from dgs.dgs_addon.scene.surface import SURFACE  # noqa: E402
from dgs.tests.card_twin import DEPTH, FOCAL, write_card_twin  # noqa: E402


@pytest.fixture(autouse=True)
def empty_scene() -> Iterator[None]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    yield
    bpy.ops.wm.read_factory_settings(use_empty=True)


def square() -> Mesh:
    """Two faces, one in the red quarter of its texture (upper left), one in the blue (lower left)."""
    image = np.zeros((8, 8, 3), np.uint8)
    image[:4, :4], image[:4, 4:], image[4:, :4] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    places = np.array([[0.1, 0.9], [0.3, 0.9], [0.1, 0.7], [0.1, 0.3], [0.3, 0.3], [0.1, 0.1]])
    texture = Texture(image, places, np.array([0, 2, 1, 1, 2, 3]), np.array([[0, 1, 2], [3, 4, 5]]))
    vertices = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 2]])
    return Mesh(vertices, np.array([[0, 2, 1], [1, 2, 3]]), None, None, texture)


def picture_of(thing: Any) -> Any:
    """The picture that the base colour of an object's material is."""
    (material,) = thing.data.materials
    (shader,) = [node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"]
    (link,) = shader.inputs["Base Color"].links
    assert link.from_node.type == "TEX_IMAGE"
    return link.from_node.image


def texels(thing: Any) -> np.ndarray:
    """[M, 3] the texels under the middles of the faces."""
    picture = picture_of(thing)
    pixels = np.array(picture.pixels).reshape(picture.size[1], picture.size[0], -1)[..., :3]
    uvs = np.array([one.uv[:] for one in thing.data.uv_layers.active.data]).reshape(-1, 3, 2).mean(axis=1)
    assert uvs.min() >= 0.0 and uvs.max() <= 1.0
    column, row = (uvs * [picture.size[0], picture.size[1]]).astype(int).T
    return pixels[row, column]


@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_blender_reads_the_texture_where_it_was_written(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"m{suffix}"
    write_mesh(file, square())
    if suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(file))
    else:
        bpy.ops.wm.obj_import(filepath=str(file))
    (thing,) = [one for one in bpy.data.objects if one.type == "MESH"]
    assert np.allclose(texels(thing), [[1, 0, 0], [0, 0, 1]]) and picture_of(thing).colorspace_settings.name == "sRGB"
    assert not thing.data.color_attributes and len(thing.data.polygons) == 2
    heights = sorted(vertex.co.y if suffix == ".glb" else -vertex.co.z for vertex in thing.data.vertices)
    assert heights[0] >= -2.01


def test_make_mesh_with_a_texture(tmp_path: Path) -> None:
    dgs.register()
    try:
        twin = add_twin_of(write_card_twin(tmp_path), bpy.context.scene)
        twin.scale, twin.location = (2.0, 2.0, 2.0), (1.0, 0.0, 0.0)
        for _ in range(2):  # the second takes the place of the first
            assert bpy.ops.dgs.make_mesh(faces=500, texture="1024") == {"FINISHED"}
        (surface,) = [child for child in twin.children if child.get(SURFACE)]
        bpy.context.view_layer.update()
        places = np.array([surface.matrix_world @ vertex.co for vertex in surface.data.vertices])
        back = np.c_[places, np.ones(len(places))] @ np.linalg.inv(from_file(twin)).T
        assert np.median(abs(back[:, 2] - DEPTH)) < 0.5 * DEPTH / FOCAL and np.abs(back[:, 0]).max() > 0.5
        assert 100 < len(surface.data.polygons) <= 500 and len(places) < 450, "welded"
        picture = picture_of(surface)
        assert picture.packed_file is not None and tuple(picture.size) == (1024, 1024)
        assert np.ptp(texels(surface), axis=0).max() > 0.2, "the card is painted"
        assert len([one for one in bpy.data.images if one.size[0] == 1024]) == 1
        assert bpy.ops.dgs.make_mesh(faces=500) == {"FINISHED"}
        (surface,) = [child for child in twin.children if child.get(SURFACE)]
        assert len(surface.data.color_attributes) == 1 and picture_of_none(surface)
        assert not [one for one in bpy.data.images if one.size[0] == 1024], "nothing is left of it"
    finally:
        dgs.unregister()


def picture_of_none(thing: Any) -> bool:
    """Whether no picture is in its material."""
    return all(node.type != "TEX_IMAGE" for node in thing.data.materials[0].node_tree.nodes)
