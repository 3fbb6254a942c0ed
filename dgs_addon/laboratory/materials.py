"""Materials of the laboratory, built from shader nodes that Blender 4.2 to 5.x share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

from .lines import Line

Colour = tuple[float, float, float]


class Graph:
    """Shorthand for building one material's node tree."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        if self.material.node_tree is None:  # Blender 5 gives every material its nodes
            self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def node(self, kind: str, **properties: Any) -> Any:
        """A new node of a kind, with these properties."""
        node = self.tree.nodes.new(kind)
        for key, value in properties.items():
            setattr(node, key, value)
        return node

    def put(self, socket: Any, value: Any) -> None:
        """Links an output to a socket, or sets its value: a number, or a linear Rec. 709 colour of three."""
        if hasattr(value, "is_output"):
            self.tree.links.new(value, socket)
        elif isinstance(value, tuple) and socket.type == "RGBA":
            socket.default_value = (*value, 1.0)
        else:
            socket.default_value = value

    def math(self, operation: str, *values: Any) -> Any:
        """The output of a Math node; values: outputs or numbers."""
        node = self.node("ShaderNodeMath", operation=operation)
        for socket, value in zip(node.inputs, values, strict=False):
            self.put(socket, value)
        return node.outputs[0]

    def mix(self, share: Any, first: Any, second: Any, blend: str = "MIX") -> Any:
        """The output of a Mix node for colours; share 0 is the first alone."""
        node = self.node("ShaderNodeMix", data_type="RGBA", blend_type=blend)
        # Sockets by index: names of this node differ between versions. 6 and 7 are the colours.
        self.put(node.inputs[0], share)
        self.put(node.inputs[6], first)
        self.put(node.inputs[7], second)
        return node.outputs[2]

    def ramp(self, value: Any, stops: Sequence[tuple[float, Colour]], constant: bool = False) -> Any:
        """Colours by a value in [0, 1], stops at rising positions; constant: steps instead of blends."""
        node = self.node("ShaderNodeValToRGB")
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, colour) in zip(elements, stops, strict=True):
            element.position = position
            element.color = (*colour, 1.0)
        if constant:
            node.color_ramp.interpolation = "CONSTANT"
        self.put(node.inputs[0], value)
        return node.outputs[0]

    def attribute(self, name: str) -> Any:
        """The output of a number that the mesh has under this name."""
        return self.node("ShaderNodeAttribute", attribute_name=name).outputs["Fac"]

    def finish(self, colour: Any, roughness: float, specular: float) -> Any:
        """The material, its surface a Principled BSDF of this colour."""
        surface = self.node("ShaderNodeBsdfPrincipled")
        self.put(surface.inputs["Base Color"], colour)
        surface.inputs["Roughness"].default_value = roughness
        surface.inputs["Specular IOR Level"].default_value = specular
        output = self.node("ShaderNodeOutputMaterial")
        self.tree.links.new(surface.outputs[0], output.inputs[0])
        return self.material


def plain(name: str, colour: Colour, roughness: float = 0.6) -> Any:
    """One colour (linear Rec. 709)."""
    return Graph(name).finish(colour, roughness, 0.3)


def leather(lines: Sequence[Line]) -> Any:
    """Pebbled leather with painted lines; reads the attributes 'relief' and 'tint' of the mesh."""
    graph = Graph("leather")
    tint = graph.ramp(
        graph.attribute("tint"), [(0.0, (0.13, 0.035, 0.012)), (0.5, (0.30, 0.095, 0.030)), (1.0, (0.46, 0.18, 0.065))]
    )
    colour = graph.mix(graph.attribute("relief"), (0.020, 0.008, 0.006), tint)
    place = graph.node("ShaderNodeTexCoord").outputs["Object"]
    separate = graph.node("ShaderNodeSeparateXYZ")
    graph.put(separate.inputs[0], place)
    for line in lines:
        painted = graph.mix(graph.attribute("relief"), tuple(0.45 * c for c in line.colour), line.colour)
        colour = graph.mix(_on_line(graph, line, separate.outputs), colour, painted)
    return graph.finish(colour, 0.55, 0.25)


def _on_line(graph: Graph, line: Line, axes: Any) -> Any:
    x, y, z = axes
    if line.kind == "ring":
        return graph.math("COMPARE", x, line.position, line.width / 2)
    cosine, sine = line.direction
    across = graph.math("SUBTRACT", graph.math("MULTIPLY", y, sine), graph.math("MULTIPLY", z, cosine))
    towards = graph.math("ADD", graph.math("MULTIPLY", y, cosine), graph.math("MULTIPLY", z, sine))
    near = graph.math("COMPARE", across, 0.0, line.width / 2)
    return graph.math("MULTIPLY", near, graph.math("GREATER_THAN", towards, 0.0))


def table_top() -> Any:
    """A terrazzo of chips of every size, from 60 mm to 1 mm, that repeats nowhere."""
    graph = Graph("table")
    place = graph.node("ShaderNodeTexCoord").outputs["Object"]
    clouds = _noise(graph, place, scale=6.0, detail=7.0, roughness=0.62)
    colour = graph.ramp(
        clouds,
        [
            (0.30, (0.10, 0.12, 0.16)),
            (0.45, (0.42, 0.38, 0.30)),
            (0.55, (0.20, 0.30, 0.30)),
            (0.70, (0.62, 0.58, 0.50)),
        ],
    )
    for scale, threshold in ((18.0, 0.72), (55.0, 0.66), (160.0, 0.62), (420.0, 0.60)):
        chips = graph.node("ShaderNodeTexVoronoi", feature="F1", voronoi_dimensions="2D")
        graph.put(chips.inputs["Vector"], place)
        chips.inputs["Scale"].default_value = scale
        hue = graph.node("ShaderNodeSeparateColor")
        graph.put(hue.inputs[0], chips.outputs["Color"])
        chip = graph.ramp(
            hue.outputs[1],
            [
                (0.00, (0.03, 0.03, 0.04)),
                (0.20, (0.55, 0.50, 0.42)),
                (0.40, (0.30, 0.08, 0.05)),
                (0.55, (0.08, 0.16, 0.24)),
                (0.70, (0.70, 0.68, 0.62)),
                (0.85, (0.10, 0.20, 0.09)),
            ],
            constant=True,
        )
        chosen = graph.math("GREATER_THAN", hue.outputs[0], threshold)
        inside = graph.math("LESS_THAN", chips.outputs["Distance"], 0.47)
        colour = graph.mix(graph.math("MULTIPLY", chosen, inside), colour, chip)
    grain = _noise(graph, place, scale=240.0, detail=2.0, roughness=0.7)
    colour = graph.mix(0.35, colour, graph.ramp(grain, [(0.3, (0.25,) * 3), (0.7, (1.0,) * 3)]), "MULTIPLY")
    return graph.finish(colour, 0.7, 0.2)


def _noise(graph: Graph, place: Any, scale: float, detail: float, roughness: float) -> Any:
    # In two dimensions a sample costs a third of what it costs in three.
    noise = graph.node("ShaderNodeTexNoise", noise_dimensions="2D")
    graph.put(noise.inputs["Vector"], place)
    noise.inputs["Scale"].default_value = scale
    noise.inputs["Detail"].default_value = detail
    noise.inputs["Roughness"].default_value = roughness
    return noise.outputs[0]


def depth_and_index() -> Any:
    """Emits (depth along the camera's axis, object index, 0): one sample is exact."""
    graph = Graph("depth and index")
    # Else every one of a million triangles becomes a lamp, which takes ten seconds to sort.
    graph.material.cycles.emission_sampling = "NONE"
    combine = graph.node("ShaderNodeCombineXYZ")
    graph.put(combine.inputs[0], graph.node("ShaderNodeCameraData").outputs["View Z Depth"])
    graph.put(combine.inputs[1], graph.node("ShaderNodeObjectInfo").outputs["Object Index"])
    emission = graph.node("ShaderNodeEmission")
    graph.put(emission.inputs[0], combine.outputs[0])
    output = graph.node("ShaderNodeOutputMaterial")
    graph.tree.links.new(emission.outputs[0], output.inputs[0])
    return graph.material


def normals() -> Any:
    """Emits (n + 1) / 2, n being the unit normal in Blender's world, turned to the camera."""
    graph = Graph("normals")
    graph.material.cycles.emission_sampling = "NONE"
    scale = graph.node("ShaderNodeVectorMath", operation="MULTIPLY_ADD")
    graph.put(scale.inputs[0], graph.node("ShaderNodeNewGeometry").outputs["Normal"])
    scale.inputs[1].default_value = scale.inputs[2].default_value = (0.5, 0.5, 0.5)
    emission = graph.node("ShaderNodeEmission")
    graph.put(emission.inputs[0], scale.outputs[0])
    output = graph.node("ShaderNodeOutputMaterial")
    graph.tree.links.new(emission.outputs[0], output.inputs[0])
    return graph.material


def from_vertices(attribute: str) -> Any:
    """Shows the colours that a mesh stores at its vertices."""
    graph = Graph(f"colours {attribute}")
    surface = graph.node("ShaderNodeBsdfPrincipled")
    graph.put(surface.inputs["Base Color"], graph.node("ShaderNodeVertexColor", layer_name=attribute).outputs["Color"])
    surface.inputs["Roughness"].default_value = 0.6
    output = graph.node("ShaderNodeOutputMaterial")
    graph.tree.links.new(surface.outputs[0], output.inputs[0])
    return graph.material
