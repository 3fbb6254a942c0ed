"""Geometry nodes that show a twin: one ball or card per Gaussian.

Final renders show cards that face the scene's camera (see `cards`). The viewport shows balls, which look
the same from everywhere, as do renders with 'Face Camera' off (panoramas, mirrors, shadows).

The harmonics of degree 1 are a dot product: colour_c = base_c + v_c . direction, with
v_c = C1 (-sh_2, -sh_0, sh_1) of that channel. The nodes turn v_c by the object's own rotation, so that
gloss follows a twin that is moved in the scene. Higher degrees stay in the attributes, unshown.
"""

from __future__ import annotations

from typing import Any

import bpy

from ...core.constants import SH_C0, SH_C1
from .cards import CameraSockets, cards, cards_exist
from .graph import Graph
from .live import outline
from .material import COLOUR, OPACITY, REACH, card_material, linear_light, splat_material

#: Faces of the ball lie inside its vertices' sphere; this puts them around the sphere instead.
_AROUND = 1.08
#: A ball is never flatter than this share of its length: its inverse matrix must stay usable.
_FLATTEST = 0.01
#: Named attributes that the nodes hand to the material of balls, a vector a channel.
GLOSS = ("dgs_gloss_red", "dgs_gloss_green", "dgs_gloss_blue")

SIZE_INPUT, THRESHOLD_INPUT, COUNT_INPUT, VIEWPORT_INPUT, FACE_INPUT, CROP_INPUT, BOX_INPUT, LIVE_INPUT = (
    "Splat Size",
    "Opacity Threshold",
    "Max Count",
    "Max in Viewport",
    "Face Camera",
    "Crop",
    "Crop Box",
    "Drawn Live",
)
#: Point attribute: whether a splat is hidden (see `hiding`).
HIDDEN = "hidden"
_NAME = "Descatter Splats"
#: Opacity below which splats are not shown, unless another one is chosen: nobody sees them.
FAINTEST = 0.005
#: No limit on the number of splats: more than a scene will hold.
UNLIMITED = 100_000_000


def splat_nodes(view_dependent: bool) -> Any:
    """The `bpy` node group for a twin's modifier, shared by all twins of its kind."""
    existing = bpy.data.node_groups.get(_group_name(view_dependent))
    return existing if existing is not None else _build(_group_name(view_dependent), view_dependent)


def splat_nodes_exist(view_dependent: bool) -> bool:
    """Whether `splat_nodes` is quick: building the group takes 0.2 s."""
    return _group_name(view_dependent) in bpy.data.node_groups


def _group_name(view_dependent: bool) -> str:
    return f"{_NAME}, Glossy" if view_dependent else _NAME


def splat_modifier(twin: Any) -> Any:
    """The `bpy` modifier that shows a twin's splats, or None if the user has removed it."""
    return next(
        (m for m in twin.modifiers if m.type == "NODES" and m.node_group and m.node_group.name.startswith(_NAME)), None
    )


def splat_input(modifier: Any, name: str) -> tuple[Any, str] | None:
    """Where a modifier of `splat_nodes` keeps an input: owner and property's path, as panels draw them.

    None if it has no such input. From Blender 5.2 on, inputs are properties of their own.
    """
    items = modifier.node_group.interface.items_tree
    identifier = next((item.identifier for item in items if item.name == name and item.in_out == "INPUT"), None)
    if identifier is None:
        return None
    inputs = getattr(getattr(modifier, "properties", None), "inputs", None)
    return (modifier, f'["{identifier}"]') if inputs is None else (getattr(inputs, identifier), "value")


def splat_value(modifier: Any, name: str) -> Any:
    """An input's value; None where the modifier has no such input, as of an older version, or it was never set."""
    place = splat_input(modifier, name)
    if place is None:
        return None
    owner, path = place
    return owner.value if path == "value" else owner.get(path[2:-2])


def set_splat_input(modifier: Any, name: str, value: Any) -> None:
    """Sets an input by its name.

    Raises:
        KeyError: there is none of this name.
    """
    place = splat_input(modifier, name)
    if place is None:
        raise KeyError(name)
    owner, path = place
    if path == "value":
        owner.value = value
    else:
        owner[path[2:-2]] = value
    modifier.id_data.update_tag()


def _build(name: str, view_dependent: bool) -> Any:
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.is_modifier = True
    _interface(tree)
    graph = Graph(tree)
    given = graph.node("NodeGroupInput").outputs
    points = _fewer(graph, _cropped(graph, given), given)
    points = graph.store(points, "FLOAT", OPACITY, _opacity(graph))
    rotation, radii = graph.named("QUATERNION", "rotation"), _radii(graph, given[1])
    slopes = _slopes(graph) if view_dependent else []
    instances = _balls(graph, points, rotation, radii, slopes)
    if cards_exist():
        final = graph.math("SUBTRACT", 1.0, graph.node("GeometryNodeIsViewport").outputs[0])
        facing = graph.math("MULTIPLY", final, given[5])
        flat = _cards(graph, points, rotation, radii, slopes)
        instances = graph.node("GeometryNodeSwitch", facing, instances, flat, input_type="GEOMETRY").outputs[0]
    live = graph.math("MULTIPLY", given[LIVE_INPUT], graph.node("GeometryNodeIsViewport").outputs[0])
    shown = graph.node("GeometryNodeSwitch", live, instances, outline(graph, given[0]), input_type="GEOMETRY").outputs[
        0
    ]
    graph.node("NodeGroupOutput", shown)
    return tree


def _balls(graph: Graph, points: Any, rotation: Any, radii: Any, slopes: list[Any]) -> Any:
    points = graph.store(points, "FLOAT_VECTOR", COLOUR, _base(graph))
    if slopes:
        itself = graph.node("GeometryNodeSelfObject").outputs[0]
        info = graph.node("GeometryNodeObjectInfo", itself, transform_space="ORIGINAL").outputs
        turn = next(socket for socket in info if socket.name == "Rotation")
        for name, slope in zip(GLOSS, slopes, strict=True):
            turned = graph.node("FunctionNodeRotateVector", slope, turn).outputs[0]
            points = graph.store(points, "FLOAT_VECTOR", name, turned)
    ball = graph.node("GeometryNodeMeshIcoSphere", _AROUND, 2).outputs[0]
    ball = graph.node("GeometryNodeSetMaterial", ball, None, splat_material()).outputs[0]
    return graph.node("GeometryNodeInstanceOnPoints", points, None, ball, None, None, rotation, radii).outputs[0]


def _cards(graph: Graph, points: Any, rotation: Any, radii: Any, slopes: list[Any]) -> Any:
    """All that one view needs is worked out here, once a splat, and not at every crossing of a ray with a card."""
    view = CameraSockets(graph)
    colour = _base(graph)
    if slopes:
        gloss = (graph.vector("DOT_PRODUCT", slope, view.towards) for slope in slopes)
        colour = graph.vector("ADD", colour, graph.node("ShaderNodeCombineXYZ", *gloss).outputs[0])
    red, green, blue = graph.node("ShaderNodeSeparateXYZ", linear_light(graph, colour)).outputs
    shown = graph.node("FunctionNodeCombineColor", red, green, blue, _opacity(graph)).outputs[0]
    points = graph.store(points, "FLOAT_COLOR", COLOUR, shown)
    return cards(graph, points, view, rotation, radii, card_material())


def _interface(tree: Any) -> None:
    new = tree.interface.new_socket
    new("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    new("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    for name, kind, default, low, high, text in (
        (SIZE_INPUT, "NodeSocketFloat", 1.0, 0.0, 10.0, "Factor on the size of all splats"),
        (THRESHOLD_INPUT, "NodeSocketFloat", FAINTEST, 0.0, 1.0, "Fainter splats are not shown"),
        (COUNT_INPUT, "NodeSocketInt", UNLIMITED, 0, UNLIMITED, "Most splats in a render, spread evenly over the twin"),
        (VIEWPORT_INPUT, "NodeSocketInt", 100_000, 0, UNLIMITED, "Most splats in the viewport, spread evenly"),
    ):
        socket = new(name, in_out="INPUT", socket_type=kind)
        socket.description = text
        socket.default_value, socket.min_value, socket.max_value = default, low, high
    if cards_exist():
        facing = new(FACE_INPUT, in_out="INPUT", socket_type="NodeSocketBool")
        facing.default_value = True
        facing.description = "Render exactly as trained, for the scene's camera; off for panoramas and mirrors"
    crop = new(CROP_INPUT, in_out="INPUT", socket_type="NodeSocketBool")
    crop.description = "Show only the splats whose centres lie in the box"
    new(
        BOX_INPUT, in_out="INPUT", socket_type="NodeSocketObject"
    ).description = (
        "An object whose own space from -1 to 1 is the box: an empty cube, or a mesh cube as Blender adds it"
    )
    live = new(LIVE_INPUT, in_out="INPUT", socket_type="NodeSocketBool")
    live.description = "The viewport shows an outline only, as Descatter draws the splats over the scene itself"


def _cropped(graph: Graph, given: Any) -> Any:
    """The points that are not hidden and lie inside the box, wherever box and twin were moved, turned or scaled."""
    crop, box = (next(s for s in given if s.name == name) for name in (CROP_INPUT, BOX_INPUT))
    info = graph.node("GeometryNodeObjectInfo", box, transform_space="RELATIVE").outputs
    place = next(socket for socket in info if socket.name == "Transform")
    back = graph.node("FunctionNodeInvertMatrix", place).outputs[0]
    position = graph.node("GeometryNodeInputPosition").outputs[0]
    inside = graph.node("FunctionNodeTransformPoint", position, back).outputs[0]
    x, y, z = graph.node("ShaderNodeSeparateXYZ", graph.vector("ABSOLUTE", inside)).outputs
    beyond = graph.math("GREATER_THAN", graph.math("MAXIMUM", graph.math("MAXIMUM", x, y), z), 1.0)
    kept = graph.math("SUBTRACT", 1.0, graph.math("MULTIPLY", beyond, crop))
    kept = graph.math("SUBTRACT", kept, graph.named("BOOLEAN", HIDDEN))
    return graph.node("GeometryNodeSeparateGeometry", given[0], kept).outputs[0]


def _fewer(graph: Graph, points: Any, given: Any) -> Any:
    """The points that are opaque enough, at most as many as wanted."""
    total = graph.node("GeometryNodeAttributeDomainSize", points).outputs[0]
    most = graph.node(
        "GeometryNodeSwitch",
        graph.node("GeometryNodeIsViewport").outputs[0],
        given[3],
        graph.math("MINIMUM", given[3], given[4]),
        input_type="INT",
    ).outputs[0]
    share = graph.math("MINIMUM", graph.math("DIVIDE", most, total), 1.0)
    index = graph.node("GeometryNodeInputIndex").outputs[0]
    before = graph.math("FLOOR", graph.math("MULTIPLY", index, share))
    after = graph.math("FLOOR", graph.math("MULTIPLY", graph.math("ADD", index, 1.0), share))
    counted = graph.math("GREATER_THAN", after, before)
    faint = graph.math("LESS_THAN", _opacity(graph), given[2])
    wanted = graph.math("GREATER_THAN", counted, faint)
    return graph.node("GeometryNodeSeparateGeometry", points, wanted).outputs[0]


def _radii(graph: Graph, size: Any) -> Any:
    scale = graph.named("FLOAT_VECTOR", "scale")
    x, y, z = graph.node("ShaderNodeSeparateXYZ", scale).outputs
    longest = graph.math("MAXIMUM", graph.math("MAXIMUM", x, y), z)
    shortest = graph.math("MULTIPLY", longest, _FLATTEST)
    thick = graph.vector("MAXIMUM", scale, graph.node("ShaderNodeCombineXYZ", *[shortest] * 3).outputs[0])
    return graph.vector("SCALE", thick, graph.math("MULTIPLY", size, REACH))


def _base(graph: Graph) -> Any:
    base = graph.named("FLOAT_COLOR", "radiance:base")
    return graph.vector("ADD", graph.vector("SCALE", base, SH_C0), (0.5, 0.5, 0.5))


def _slopes(graph: Graph) -> list[Any]:
    """v_c of red, green and blue in the twin's own axes."""
    first, second, third = (
        graph.node("ShaderNodeSeparateXYZ", graph.named("FLOAT_VECTOR", f"radiance:sh_{i}")).outputs for i in range(3)
    )
    return [
        graph.vector(
            "MULTIPLY",
            graph.node("ShaderNodeCombineXYZ", third[c], first[c], second[c]).outputs[0],
            (-SH_C1, -SH_C1, SH_C1),
        )
        for c in range(3)
    ]


def _opacity(graph: Graph) -> Any:
    base = graph.named("FLOAT_COLOR", "radiance:base")
    return graph.node("FunctionNodeSeparateColor", base).outputs[3]
