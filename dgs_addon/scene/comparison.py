"""What has changed of a twin since an earlier one: a coloured mesh where the twin stands, and what the panel says.

The mesh is the earlier twin's surface with what is new beside it. Its colours are an attribute of the corners, for
pictures, and materials of the faces, whose colours Solid views show, too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...core.change.files import MESH, REPORT
from ...core.colour import linear_to_srgb, srgb_to_linear
from ...core.errors import FormatError
from ...core.files import read_json
from ...core.formats.gltf_file import open_gltf
from ...core.json_shape import check_shape, count, number, text
from .graph import new_material
from .measures import from_file, rounded
from .removal import remove_unused

#: Property of a twin: what has changed, as JSON; of a mesh: that it shows it.
CHANGES, CHANGED_MESH = "dgs_changes", "dgs_changed_mesh"
#: Kinds of changes: how each is said, and an icon of its colour.
KINDS: Mapping[str, tuple[str, str]] = {
    "moved": ("Moved by {value} {unit} ({low} to {high})", "COLORSET_09_VEC"),
    "grew": ("Wider by {value} {unit} ({low} to {high})", "COLORSET_09_VEC"),
    "shrank": ("Narrower by {value} {unit} ({low} to {high})", "COLORSET_09_VEC"),
    "vanished": ("Gone: stood out by {value} {unit} ({low} to {high})", "COLORSET_01_VEC"),
    "appeared": ("New: stands out by {value} {unit} ({low} to {high})", "COLORSET_03_VEC"),
    "repainted": ("Looks different where it stood", "COLORSET_06_VEC"),
}
#: Corners' colours in the mesh.
_COLOUR = "Change"
#: A glTF's y points up and its z towards the viewer, the engine's the other way.
_TURNED = np.array([1.0, -1.0, -1.0])
#: Between channels of a grey (sRGB of 255): what has not changed is grey.
_GREY = 10.0
_RGB = [count]
_REGION = {"kind": frozenset(KINDS), "value": (number,), "low": (number,), "high": (number,), "unit": text}
_REPORT = {
    "regions": [_REGION],
    "surface": {"places": count, "held": count},
    "alignment": {"scale": number, "rotation": [[number]], "translation": [number]},
    "colours": {**dict.fromkeys(("vanished", "appeared", "repainted", "unseen"), _RGB), "moved": {"bar": [_RGB]}},
}
_KEPT = {"before": text, "held": count, "places": count, "regions": [_REGION]}


def add_changes(twin: Any, folder: Path, before: str, scene: Any) -> Any:
    """Puts what `change` has found into the scene, in place of what was found before, and shows it for the twin.

    Args:
        twin: the later one; folder: that the command wrote; before: what the earlier twin is called.

    Returns:
        The mesh object, a child of the twin.

    Raises:
        FormatError: a file is missing or damaged, or the twin is of several files.
    """
    report = _read(folder / REPORT)
    mesh = _mesh(folder / MESH, report["colours"], f"{twin.name} changes")
    world = from_file(twin) @ np.linalg.inv(_into_first(report["alignment"]))
    for other in _meshes_of(twin):
        data = other.data
        bpy.data.objects.remove(other)
        remove_unused(data)
    thing = bpy.data.objects.new(f"{twin.name} changes", mesh)
    thing[CHANGED_MESH] = True
    (twin.users_collection[0] if twin.users_collection else scene.collection).objects.link(thing)
    thing.parent = twin
    thing.matrix_parent_inverse = twin.matrix_world.inverted()
    thing.matrix_basis = Matrix(world.tolist())
    surface, regions = report["surface"], [{key: one[key] for key in _REGION} for one in report["regions"]]
    kept = {"before": before, "held": surface["held"], "places": surface["places"], "regions": regions}
    twin[CHANGES] = json.dumps(kept)
    show_changes(twin, True, scene)
    return thing


def changes_of(twin: Any) -> dict[str, Any] | None:
    """What is known of a twin's changes: `before`, `held`, `places`, `regions`; None where nobody has compared it."""
    try:
        kept: dict[str, Any] = json.loads(str(twin[CHANGES]))
        check_shape(kept, _KEPT)
    except (KeyError, ValueError, RecursionError):
        return None
    return kept


def changed_mesh(twin: Any) -> Any:
    """The mesh that shows a twin's changes, or None."""
    return next(iter(_meshes_of(twin)), None)


def shows_changes(twin: Any) -> bool:
    """Whether they are shown in the twin's place."""
    mesh = changed_mesh(twin)
    return mesh is not None and not mesh.hide_render


def show_changes(twin: Any, on: bool, scene: Any) -> None:
    """Shows the changes in the place of the twin, in views and pictures; or the twin."""
    for thing, hidden in ((twin, on), *((mesh, not on) for mesh in _meshes_of(twin))):
        thing.hide_render = hidden
        for layer in scene.view_layers:
            layer.update()  # else it has no object of a new mesh yet
            if thing.name in layer.objects:
                thing.hide_set(hidden, view_layer=layer)


def line_of(region: Mapping[str, Any]) -> tuple[str, str, dict[str, str]]:
    """How a region is said: a text with places for figures, an icon, and the figures."""
    said, icon = KINDS[region["kind"]]
    if region["value"] is None or region["low"] is None or region["high"] is None:
        return KINDS["repainted"][0], icon, {}
    half = max(region["value"] - region["low"], region["high"] - region["value"])
    figures = {name: rounded(region[name], half) for name in ("value", "low", "high")}
    return said, icon, {**figures, "unit": {"px-equivalent": "px"}.get(region["unit"], region["unit"])}


def _meshes_of(twin: Any) -> list[Any]:
    return [child for child in twin.children if child.get(CHANGED_MESH)]


def _read(path: Path) -> dict[str, Any]:
    try:
        report: dict[str, Any] = read_json(path)
        check_shape(report, _REPORT)
        colours = report["colours"]
        rows = [*(colours[kind] for kind in ("vanished", "appeared", "repainted", "unseen")), *colours["moved"]["bar"]]
        np.array(rows, float).reshape(-1, 3)
        _into_first(report["alignment"])
    except (OSError, ValueError) as error:
        raise FormatError(f"'{path}' cannot be used ({error})", "Compare the twins again") from error
    return report


def _into_first(alignment: Mapping[str, Any]) -> NDArray[np.float64]:
    """[4, 4] from the later twin's world into the earlier one's; raises ValueError."""
    matrix = np.eye(4)
    matrix[:3, :3] = alignment["scale"] * np.array(alignment["rotation"], float).reshape(3, 3)
    matrix[:3, 3] = np.array(alignment["translation"], float).reshape(3)
    if not abs(np.linalg.det(matrix)) > 0:
        raise ValueError("the alignment has no way back")
    return matrix


def _mesh(path: Path, colours: Mapping[str, Any], name: str) -> Any:
    """A `bpy` mesh in the axes of the earlier twin's world."""
    asset = open_gltf(path)
    try:
        ((found, _),) = asset.placed_meshes()
        (part,) = found["primitives"]
        at = asset.array(part["attributes"]["POSITION"])[:, :3] * _TURNED
        shades = linear_to_srgb(asset.array(part["attributes"]["COLOR_0"])[:, :3])
        faces = asset.array(part["indices"]).astype(np.int64).reshape(-1, 3)
        if len(shades) != len(at) or not np.isfinite(at).all() or (len(faces) and faces.max() >= len(at)):
            raise ValueError("corners that are not there")
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"'{path}' is damaged ({type(error).__name__})", "Compare the twins again") from error
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(at.tolist(), [], faces.tolist())
    attribute = mesh.color_attributes.new(_COLOUR, "FLOAT_COLOR", "POINT")
    linear = np.concatenate([srgb_to_linear(shades), np.ones((len(at), 1))], axis=1)
    attribute.data.foreach_set("color", linear.astype(np.float32).reshape(-1))
    kinds = _kinds(255.0 * shades, colours)
    # a face has the kind that lies between those of its corners
    _give_materials(mesh, np.sort(kinds[faces], axis=1)[:, 1], shades[kinds == 0], colours)
    mesh.shade_smooth()
    mesh.update()
    return mesh


def _palette(colours: Mapping[str, Any]) -> dict[str, list[float]]:
    """sRGB by the name of a material, of all but what has not changed."""
    moved = colours["moved"]["bar"]
    bar = {f"Moved {index} of {len(moved)}": colour for index, colour in enumerate(moved, start=1)}
    kinds = {kind.capitalize(): colours[kind] for kind in ("unseen", "vanished", "appeared", "repainted")}
    return {"Not Seen": kinds.pop("Unseen"), **kinds, **bar}


def _kinds(shades: NDArray[np.float64], colours: Mapping[str, Any]) -> NDArray[np.int64]:
    """[N] number of the nearest colour of the palette for each corner, from 1; 0 for greys.

    Args:
        shades: [N, 3] sRGB of 255.
    """
    palette = np.array(list(_palette(colours).values()), float)
    nearest = np.linalg.norm(shades[:, None] - palette[None], axis=2).argmin(axis=1) + 1
    return np.where(np.ptp(shades, axis=1) <= _GREY, 0, nearest)


def _give_materials(
    mesh: Any, kinds: NDArray[np.int64], greys: NDArray[np.float64], colours: Mapping[str, Any]
) -> None:
    """One for each kind [faces] that there is, coloured as its corners are in the middle."""
    usual = greys.mean(axis=0) if len(greys) else np.full(3, 0.85)
    named = {"Unchanged": usual, **{name: np.array(rgb) / 255.0 for name, rgb in _palette(colours).items()}}
    used, slots = np.unique(kinds, return_inverse=True)
    for name, shade in (list(named.items())[kind] for kind in used):
        mesh.materials.append(_material(f"Descatter Change: {name}", srgb_to_linear(shade)))
    mesh.polygons.foreach_set("material_index", slots.reshape(-1).astype(np.int32))


def _material(name: str, linear: NDArray[np.float64]) -> Any:
    """Lit as matter is, in the colours of the corners; plain views show one colour."""
    material = bpy.data.materials.get(name)
    if material is None:
        material, graph = new_material(name)
        shader = graph.node("ShaderNodeBsdfPrincipled")
        shader.inputs["Roughness"].default_value = 0.9
        graph.plug(shader.inputs["Base Color"], graph.node("ShaderNodeVertexColor", layer_name=_COLOUR).outputs[0])
        graph.node("ShaderNodeOutputMaterial", shader.outputs[0])
    material.diffuse_color = (*linear.tolist(), 1.0)
    return material
