"""The points that structure from motion found, as an object: what the cameras agree on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.formats.colmap import read_colmap_points
from ..axes import points_to_blender
from .graph import Graph, new_material

POINTS = "dgs_points"
_COLOUR, _NODES, _MATERIAL = "colour", "Descatter Points", "Descatter Points"
#: Radius of a point as a share of the median distance from the middle.
_RADIUS = 0.004


def add_points(model: Path, name: str, collection: Any) -> Any:
    """Adds a COLMAP model's points, coloured as in the photos; None if it has none.

    They are for the eye only: the object is not rendered.

    Args:
        model: folder of the model.
        name: of the object.
        collection: `bpy` collection for it.

    Raises:
        FormatError: no model there, or damaged points.
    """
    points = read_colmap_points(model)
    if not len(points.positions):
        return None
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points.positions))
    places = points_to_blender(points.positions).astype(np.float32)
    mesh.attributes["position"].data.foreach_set("vector", places.reshape(-1))
    colours = np.ones((len(places), 4), np.float32)
    colours[:, :3] = points.colours / np.float32(255)
    # Byte colours are sRGB-encoded in Blender, as the photos are.
    attribute = mesh.attributes.new(_COLOUR, "BYTE_COLOR", "POINT")
    attribute.data.foreach_set("color_srgb", colours.reshape(-1))
    mesh.update()
    thing = bpy.data.objects.new(name, mesh)
    thing[POINTS] = len(places)
    thing.hide_render = True
    collection.objects.link(thing)
    spread = float(np.median(np.linalg.norm(places - np.median(places, axis=0), axis=1)))
    _show(thing, _RADIUS * max(spread, 1e-6))
    return thing


def _show(thing: Any, radius: float) -> None:
    """As small spheres, in the viewport's own way of drawing points."""
    modifier = thing.modifiers.new("Points", "NODES")
    modifier.node_group = bpy.data.node_groups.get(_NODES) or _nodes()
    identifier = next(i.identifier for i in modifier.node_group.interface.items_tree if i.name == "Radius")
    inputs = getattr(getattr(modifier, "properties", None), "inputs", None)
    if inputs is None:
        modifier[identifier] = radius
    else:
        getattr(inputs, identifier).value = radius


def _nodes() -> Any:
    tree = bpy.data.node_groups.new(_NODES, "GeometryNodeTree")
    tree.is_modifier = True
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    size = tree.interface.new_socket("Radius", in_out="INPUT", socket_type="NodeSocketFloat")
    size.subtype, size.default_value, size.min_value = "DISTANCE", 0.01, 0.0
    graph = Graph(tree)
    given = graph.node("NodeGroupInput").outputs
    points = graph.node("GeometryNodeMeshToPoints", given[0], None, None, given[1]).outputs[0]
    points = graph.node("GeometryNodeSetMaterial", points, None, _material()).outputs[0]
    graph.node("NodeGroupOutput", points)
    return tree


def _material() -> Any:
    existing = bpy.data.materials.get(_MATERIAL)
    if existing is not None:
        return existing
    material, graph = new_material(_MATERIAL)
    colour = graph.node("ShaderNodeAttribute", attribute_name=_COLOUR).outputs[0]
    graph.node("ShaderNodeOutputMaterial", graph.node("ShaderNodeEmission", colour, 1.0).outputs[0])
    return material
