"""Splats as flat cards that face the scene's camera: the very image the engine renders.

A card lies in the plane through the Gaussian's centre parallel to the picture, and covers what the
Gaussian covers there, projected along the ray to its centre (Zwicker's EWA, as in `core.rasterizer`).
So Cycles meets the splats in the order of their centres' depths, each once; balls would cut into each
other and show seams.

In the space where the Gaussian is the unit sphere (M = R S, S the radii) the ray to the centre has the
direction d' = M^-1 d and the picture's plane the normal n' = M^T f. A cylinder around d' cuts that plane in
an ellipse with the axes u = n' x d' (length 1) and v = n' x u (length 1 / d'.n').
"""

from __future__ import annotations

import math
from typing import Any

import bpy

from ...core.constants import ALPHA_MINIMUM
from .graph import Graph
from .material import OPACITY, PLACE, REACH

_SHARE = "dgs_share"
#: Corners of a card; more cost time, fewer waste area.
_CORNERS = 8
#: Attributes of a twin that its cards need no more: each would be copied to every corner.
_SPENT = ("scale", "rotation", "radiance:base", OPACITY, *(f"radiance:sh_{index}" for index in range(15)))
#: Cards whose ray leaves the camera's axis by more than acos of this are dropped: their projection explodes.
_MINIMUM_COSINE = 0.1


def cards_exist() -> bool:
    """Whether this Blender's geometry nodes have the scene's camera as an input."""
    return hasattr(bpy.types, "GeometryNodeInputActiveCamera")


class CameraSockets:
    """Sockets about the scene's camera, in the twin's own axes."""

    def __init__(self, graph: Graph) -> None:
        camera = graph.node("GeometryNodeInputActiveCamera").outputs[0]
        info = graph.node("GeometryNodeObjectInfo", camera, transform_space="RELATIVE").outputs
        position = graph.node("GeometryNodeInputPosition").outputs[0]
        turn = next(socket for socket in info if socket.name == "Rotation")
        place = next(socket for socket in info if socket.name == "Location")
        #: The direction the camera looks in.
        self.forward = graph.node("FunctionNodeRotateVector", (0.0, 0.0, -1.0), turn).outputs[0]
        #: Per splat: unit vector from the camera to its centre.
        self.towards = graph.vector("NORMALIZE", graph.vector("SUBTRACT", position, place))


def cards(graph: Graph, points: Any, view: CameraSockets, rotation: Any, radii: Any, material: Any) -> Any:
    """A mesh with a card for each of `points`; the sockets `rotation` and `radii` are fields of the points.

    One mesh, not instances: a renderer then has one tree of triangles to search instead of one within another.
    A faint splat's card is smaller: it ends where ALPHA_MINIMUM is left of it, as in the engine.
    """
    points = graph.store(points, "FLOAT", _SHARE, _share(graph))
    radii = graph.vector("SCALE", radii, graph.named("FLOAT", _SHARE))
    cosine = graph.vector("DOT_PRODUCT", view.towards, view.forward)
    ahead = graph.math("GREATER_THAN", cosine, _MINIMUM_COSINE)
    points = graph.node("GeometryNodeSeparateGeometry", points, ahead).outputs[0]
    card = graph.node("GeometryNodeMeshCircle", _CORNERS, 1.0824, fill_type="NGON").outputs[0]
    card = graph.node("GeometryNodeSetMaterial", card, None, material).outputs[0]
    card = graph.store(card, "FLOAT_VECTOR", PLACE, graph.node("GeometryNodeInputPosition").outputs[0])
    instances = graph.node("GeometryNodeInstanceOnPoints", points, None, card).outputs[0]
    matrix = _matrix(graph, view, rotation, radii)
    instances = graph.node("GeometryNodeSetInstanceTransform", instances, None, matrix).outputs[0]
    for name in _SPENT:
        node = graph.node("GeometryNodeRemoveAttribute", instances)
        graph.plug(node.inputs["Name"], name)  # its place differs between versions
        instances = node.outputs[0]
    mesh = graph.node("GeometryNodeRealizeInstances", instances).outputs[0]
    place = graph.vector("SCALE", graph.named("FLOAT_VECTOR", PLACE), graph.named("FLOAT", _SHARE))
    return graph.store(mesh, "FLOAT_VECTOR", PLACE, place)


def _share(graph: Graph) -> Any:
    """How much of REACH a splat's opacity fills."""
    opacity = graph.named("FLOAT", OPACITY)
    ratio = graph.math("MAXIMUM", graph.math("MULTIPLY", opacity, 1.0 / ALPHA_MINIMUM), 1.001)
    reach = graph.math("SQRT", graph.math("MULTIPLY", graph.math("LOGARITHM", ratio, math.e), 2.0))
    return graph.math("MINIMUM", graph.math("DIVIDE", reach, REACH), 1.0)


def _matrix(graph: Graph, view: CameraSockets, rotation: Any, radii: Any) -> Any:
    back = graph.node("FunctionNodeInvertRotation", rotation).outputs[0]

    def own(vector: Any) -> Any:
        return graph.node("FunctionNodeRotateVector", vector, back).outputs[0]

    def world(vector: Any) -> Any:
        return graph.node("FunctionNodeRotateVector", graph.vector("MULTIPLY", radii, vector), rotation).outputs[0]

    along = graph.vector("NORMALIZE", graph.vector("DIVIDE", own(view.towards), radii))
    normal = graph.vector("NORMALIZE", graph.vector("MULTIPLY", own(view.forward), radii))
    across = graph.vector("CROSS_PRODUCT", normal, along)
    # Seen straight on, any axis in the plane will do.
    anything = graph.vector("CROSS_PRODUCT", normal, (0.612, 0.137, -0.779))
    straight = graph.math("LESS_THAN", graph.vector("LENGTH", across), 1e-4)
    u = graph.node("GeometryNodeSwitch", straight, across, anything, input_type="VECTOR").outputs[0]
    u = graph.vector("NORMALIZE", u)
    v = graph.vector("CROSS_PRODUCT", normal, u)
    stretch = graph.math("DIVIDE", 1.0, graph.math("MAXIMUM", graph.vector("DOT_PRODUCT", along, normal), 1e-6))
    columns = (world(u), graph.vector("SCALE", world(v), stretch), _thin(graph, view, radii))
    position = graph.node("GeometryNodeInputPosition").outputs[0]
    node = graph.node("FunctionNodeCombineMatrix")
    for column, vector in enumerate((*columns, position)):
        for row, value in enumerate(graph.node("ShaderNodeSeparateXYZ", vector).outputs):
            graph.plug(node.inputs[4 * column + row], value)
    return node.outputs[0]


def _thin(graph: Graph, view: CameraSockets, radii: Any) -> Any:
    """The third axis: a card is flat, but its matrix must have an inverse."""
    return graph.vector("SCALE", view.forward, graph.vector("LENGTH", radii))
