"""Meshes of the scene in Rendered mode: where they are and how they lie, so that splats hide them and are hidden.

They are drawn plainly, in their materials' viewport colours, lit from the eye: the engine itself draws splats only. A
holdout is drawn as nothing at all, with its depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..scene.twin import is_twin
from .holdouts import is_holdout

_VERTEX = """
void main()
{
  turned = normal;
  gl_Position = projection * vec4(pos, 1.0);
}
"""
#: `eye` points from the mesh towards the viewer, in the mesh's own axes.
_FRAGMENT = """
void main()
{
  seen = vec4(colour.rgb * (0.25 + 0.75 * abs(dot(normalize(turned), eye))), colour.a);
}
"""
#: Colour of what has no material: Blender's own.
_GREY = (0.8, 0.8, 0.8)
#: What is seen of a holdout.
_NOTHING = (0.0, 0.0, 0.0, 0.0)

#: From what is seen to the viewer, in the view's axes.
_TOWARDS = Vector((0.0, 0.0, 1.0))

_shader: Any = None
#: Triangles on the graphics card by the mesh's number in this session; dropped when anything has changed.
_batches: dict[int, Any] = {}


@dataclass(frozen=True)
class ShownMesh:
    """An evaluated `bpy` object, its matrix in the world, and whether it is a holdout."""

    thing: Any
    matrix: Any
    holdout: bool

    @property
    def colour(self) -> tuple[float, ...]:
        """Linear, with alpha."""
        if self.holdout:
            return _NOTHING
        material = self.thing.active_material
        return (*(_GREY if material is None else material.diffuse_color[:3]), 1.0)


def visible_meshes(depsgraph: Any, space: Any) -> list[ShownMesh]:
    """All meshes but twins that the 3D view shows, instances too."""
    found, layer = [], depsgraph.view_layer
    for instance in depsgraph.object_instances:
        thing, of = instance.object, instance.parent if instance.is_instance else instance.object
        shown = instance.is_instance or (instance.show_self and thing.original.visible_in_viewport_get(space))
        if shown and thing.type == "MESH" and not is_twin(of):
            found.append(ShownMesh(thing, instance.matrix_world.copy(), is_holdout(of.original, layer)))
    return found


def draw_meshes(meshes: list[ShownMesh], view: Any, window: Any) -> None:
    """Draws into what is bound, with depth."""
    shader = _made()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    shader.bind()
    for mesh in meshes:
        batch = _batch(shader, mesh.thing)
        if batch is None:
            continue
        eye = (view @ mesh.matrix).to_3x3().inverted_safe() @ _TOWARDS
        shader.uniform_float("projection", window @ view @ mesh.matrix)
        shader.uniform_float("eye", eye.normalized())
        shader.uniform_float("colour", mesh.colour)
        batch.draw(shader)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


def forget_meshes() -> None:
    """Reads all meshes again when they are drawn next."""
    _batches.clear()


def _made() -> Any:
    global _shader
    if _shader is None:
        between = gpu.types.GPUStageInterfaceInfo("descatter_normal")
        between.smooth("VEC3", "turned")
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC3", "pos")
        info.vertex_in(1, "VEC3", "normal")
        info.vertex_out(between)
        info.push_constant("MAT4", "projection")
        info.push_constant("VEC3", "eye")
        info.push_constant("VEC4", "colour")
        info.fragment_out(0, "VEC4", "seen")
        info.vertex_source(_VERTEX)
        info.fragment_source(_FRAGMENT)
        _shader = gpu.shader.create_from_info(info)
    return _shader


def _batch(shader: Any, thing: Any) -> Any:
    """The mesh's triangles with the normals of their corners; None where it has none."""
    mesh = thing.data
    key = mesh.session_uid
    if key not in _batches:
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        corners = np.empty(3 * count, np.int32)
        mesh.loop_triangles.foreach_get("loops", corners)
        vertices = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", vertices)
        positions = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", positions)
        normals = np.empty(3 * len(mesh.loops), np.float32)
        mesh.corner_normals.foreach_get("vector", normals)
        content = {"pos": positions.reshape(-1, 3)[vertices[corners]], "normal": normals.reshape(-1, 3)[corners]}
        _batches[key] = batch_for_shader(shader, "TRIS", content) if count else None
    return _batches[key]
