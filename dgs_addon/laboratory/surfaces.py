"""Blender's procedural textures as materials of the laboratory's scenes; sizes are in metres of each object."""

from __future__ import annotations

from typing import Any

from .materials import Colour, Graph


def finished(graph: Graph, colour: Any, roughness: Any, metallic: float = 0.0, bump: Any = None) -> Any:
    """The material: how rough, how metallic, and bumps from a height in [0, 1]."""
    surface = graph.node("ShaderNodeBsdfPrincipled")
    graph.put(surface.inputs["Base Color"], colour)
    graph.put(surface.inputs["Roughness"], roughness)
    surface.inputs["Metallic"].default_value = metallic
    if bump is not None:
        bent = graph.node("ShaderNodeBump")
        bent.inputs["Strength"].default_value = 0.4
        bent.inputs["Distance"].default_value = 0.01
        graph.put(bent.inputs["Height"], bump)
        graph.put(surface.inputs["Normal"], bent.outputs[0])
    output = graph.node("ShaderNodeOutputMaterial")
    graph.tree.links.new(surface.outputs[0], output.inputs[0])
    return graph.material


def dimmed(colour: Colour, share: float) -> Colour:
    """The same hue, darker; brighter where `share` is above 1."""
    red, green, blue = colour
    return min(1.0, share * red), min(1.0, share * green), min(1.0, share * blue)


def place(graph: Graph, stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Any:
    """Coordinates on the object, each axis `stretch` times as dense; every copy has its own part of the texture."""
    at = graph.node("ShaderNodeTexCoord").outputs["Object"]
    moved = graph.node("ShaderNodeVectorMath", operation="MULTIPLY_ADD")
    graph.put(moved.inputs[0], at)
    moved.inputs[1].default_value = stretch
    graph.put(moved.inputs[2], graph.math("MULTIPLY", graph.node("ShaderNodeObjectInfo").outputs["Random"], 37.0))
    return moved.outputs[0]


def noise(graph: Graph, at: Any, scale: float, detail: float = 4.0, roughness: float = 0.6) -> Any:
    """Clouds in [0, 1], about 0.5."""
    node = graph.node("ShaderNodeTexNoise")
    graph.put(node.inputs["Vector"], at)
    for name, value in (("Scale", scale), ("Detail", detail), ("Roughness", roughness)):
        node.inputs[name].default_value = value
    return node.outputs[0]


def waves(graph: Graph, at: Any, scale: float, distortion: float, kind: str = "BANDS") -> Any:
    """Stripes or rings in [0, 1], bent by noise."""
    node = graph.node("ShaderNodeTexWave", wave_type=kind)
    graph.put(node.inputs["Vector"], at)
    for name, value in (("Scale", scale), ("Distortion", distortion), ("Detail", 3.0)):
        node.inputs[name].default_value = value
    return node.outputs["Fac"]


def cells(graph: Graph, at: Any, scale: float, output: str = "Color") -> Any:
    """Voronoi's cells: a colour of each, or the distance from its middle."""
    node = graph.node("ShaderNodeTexVoronoi")
    graph.put(node.inputs["Vector"], at)
    node.inputs["Scale"].default_value = scale
    return node.outputs[output]


def speckled(name: str, dark: Colour, light: Colour, scale: float, roughness: float = 0.6) -> Any:
    """Two colours by clouds, with fine grain: plaster, soil, stone, cloth."""
    graph = Graph(name)
    at = place(graph)
    clouds = noise(graph, at, scale, 8.0)
    colour = graph.ramp(clouds, [(0.35, dark), (0.65, light)])
    grain = noise(graph, at, 12 * scale, 2.0)
    colour = graph.mix(0.5, colour, graph.ramp(grain, [(0.35, (0.3,) * 3), (0.65, (1.0,) * 3)]), "MULTIPLY")
    return finished(graph, colour, roughness, bump=grain)


def wood(name: str, dark: Colour, light: Colour, scale: float, roughness: float = 0.4) -> Any:
    """Grain along x."""
    graph = Graph(name)
    at = place(graph, (0.15, 1.0, 1.0))
    rings = waves(graph, at, scale, 6.0, "RINGS")
    fibre = noise(graph, place(graph, (1.0, 12.0, 12.0)), 4 * scale, 3.0)
    colour = graph.mix(
        0.3, graph.ramp(rings, [(0.2, dark), (0.8, light)]), graph.ramp(fibre, [(0.3, dark), (0.7, light)])
    )
    return finished(graph, colour, roughness, bump=rings)


def planks(name: str, dark: Colour, light: Colour, size: tuple[float, float], gap: float = 0.004) -> Any:
    """Boards, bricks or tiles of `size` (m) with a grain of their own, laid in the plane x, y."""
    graph = Graph(name)
    at = graph.node("ShaderNodeTexCoord").outputs["Object"]
    laid = graph.node("ShaderNodeTexBrick")
    graph.put(laid.inputs["Vector"], at)
    values = {"Scale": 1.0, "Mortar Size": gap, "Brick Width": size[0], "Row Height": size[1]}
    for key, value in values.items():
        laid.inputs[key].default_value = value
    for key, colour in (("Color1", dark), ("Color2", light), ("Mortar", dimmed(dark, 0.15))):
        graph.put(laid.inputs[key], colour)
    stretched = graph.node("ShaderNodeVectorMath", operation="MULTIPLY")
    graph.put(stretched.inputs[0], at)
    stretched.inputs[1].default_value = (1.0 / size[0], 3.0 / size[1], 1.0 / size[1])
    grain = noise(graph, stretched.outputs[0], 2.0, 6.0, 0.7)
    shade = graph.ramp(grain, [(0.3, (0.45,) * 3), (0.7, (1.0,) * 3)])
    return finished(graph, graph.mix(0.8, laid.outputs["Color"], shade, "MULTIPLY"), 0.55)


def patchwork(name: str, scale: float, roughness: float = 0.5) -> Any:
    """Cells of many colours with veins: a painting, a rug, a ball, a field seen from above."""
    graph = Graph(name)
    at = place(graph)
    hue = graph.node("ShaderNodeSeparateColor")
    graph.put(hue.inputs[0], cells(graph, at, scale))
    colours = [
        (0.55, 0.06, 0.04),
        (0.75, 0.5, 0.1),
        (0.05, 0.2, 0.35),
        (0.7, 0.66, 0.55),
        (0.08, 0.28, 0.12),
        (0.03,) * 3,
    ]
    colour = graph.ramp(hue.outputs[0], [(i / 6, c) for i, c in enumerate(colours)], constant=True)
    veins = waves(graph, at, 2.5 * scale, 9.0)
    colour = graph.mix(0.6, colour, graph.ramp(veins, [(0.25, (0.35,) * 3), (0.5, (1.0,) * 3)]), "MULTIPLY")
    return finished(graph, colour, roughness)


def metal(name: str, colour: Colour, roughness: float, scratch: float = 60.0) -> Any:
    """Polished where roughness is small; fine marks on it."""
    graph = Graph(name)
    marks = noise(graph, place(graph), scratch, 6.0, 0.75)
    tint = graph.ramp(marks, [(0.3, dimmed(colour, 0.55)), (0.6, colour)])
    rough = graph.math("MULTIPLY_ADD", marks, 0.3, max(roughness - 0.15, 0.0))
    return finished(graph, tint, rough, metallic=1.0)


def foliage(name: str, dark: Colour, light: Colour, scale: float) -> Any:
    """Leaves: every copy of a tint of its own, with ribs."""
    graph = Graph(name)
    at = graph.node("ShaderNodeTexCoord").outputs["Object"]
    own = graph.node("ShaderNodeObjectInfo").outputs["Random"]
    tint = graph.mix(own, dark, light)
    ribs = waves(graph, at, scale, 1.5)
    mottled = noise(graph, at, 0.7 * scale, 5.0)
    colour = graph.mix(0.5, tint, graph.ramp(ribs, [(0.1, (0.45,) * 3), (0.5, (1.0,) * 3)]), "MULTIPLY")
    colour = graph.mix(0.5, colour, graph.ramp(mottled, [(0.35, (0.35,) * 3), (0.65, (1.0,) * 3)]), "MULTIPLY")
    return finished(graph, colour, 0.35)


def shining(name: str, dark: Colour, light: Colour, scale: float) -> Any:
    """Light from clouds of two colours, as behind a window."""
    graph = Graph(name)
    emission = graph.node("ShaderNodeEmission")
    clouds = noise(graph, place(graph), scale, 6.0)
    graph.put(emission.inputs[0], graph.ramp(clouds, [(0.35, dark), (0.65, light)]))
    output = graph.node("ShaderNodeOutputMaterial")
    graph.tree.links.new(emission.outputs[0], output.inputs[0])
    return graph.material
