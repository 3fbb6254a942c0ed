"""How a splat looks: a true Gaussian, not a ball.

In the ball's own space the Gaussian is round. The largest value that a view ray meets lies where it
passes the centre most closely, at |p x d| (p: point on the ball, d: direction, both in that space):

    alpha = opacity exp(-0.5 (REACH |p x d|)^2)

Every ball is crossed twice; only its front counts. On a card (see `cards`) the distance is that to its
middle, |p|, and the colour is computed already. The materials give off the twin's colour as light, so that
lamps leave it unchanged.

Training blends sRGB-encoded colours; Cycles blends light. Where splats half cover each other the two
differ (soft edges look wider and brighter as light). `prepare_scene` offers both.
"""

from __future__ import annotations

from typing import Any

import bpy

from .graph import Graph, new_material

NAME, CARD_NAME = "Descatter Splat", "Descatter Card"
#: Attributes that the nodes hand over: a ball's encoded colour or a card's shown one, and a card's own coordinates.
COLOUR, OPACITY, PLACE = "dgs_colour", "dgs_opacity", "dgs_place"
#: Splats end at this many standard deviations, where 1/255 of the opacity is left, as in the engine.
REACH = 3.33
_LIGHT = "Linear Light"
#: Splats are smooth and their blending is exact in every sample: few are enough for smooth borders.
SAMPLES, PREVIEW_SAMPLES = 16, 4
#: Name of the add-on's own render engine, which blends encoded colours by itself.
OWN_ENGINE = "DESCATTER"
#: A twin's look adds up behind this many crossings; each splat is crossed twice.
TRANSPARENT_BOUNCES = 256


def splat_material() -> Any:
    """The `bpy` material that all twins share."""
    existing = bpy.data.materials.get(NAME)
    return existing if existing is not None else _build()


def card_material() -> Any:
    """The `bpy` material of all cards: as little as can be, for it runs at every crossing of a ray."""
    existing = bpy.data.materials.get(CARD_NAME)
    if existing is not None:
        return existing
    material, graph = new_material(CARD_NAME)
    shown = graph.node("ShaderNodeAttribute", attribute_name=COLOUR).outputs
    place = graph.node("ShaderNodeAttribute", attribute_name=PLACE).outputs[1]
    power = graph.math("MULTIPLY", graph.vector("DOT_PRODUCT", place, place), -0.5 * REACH**2)
    alpha = graph.math("MULTIPLY", graph.math("EXPONENT", power), shown[3])
    _output(graph, shown[0], alpha)
    return material


def prepare_scene(scene: Any, as_trained: bool = False) -> None:
    """Sets what splats need to look right.

    Args:
        scene: `bpy` scene.
        as_trained: blend encoded colours, exactly as the engine does, and show them as they are ('Raw');
            lit objects then look wrong. Else the twin gives off light like any other object.

    Cycles ends rays after few transparent surfaces and, with roulette, grainily: both show as black
    specks. Other view transforms than 'Standard' change the photos' colours.
    """
    prepare_cycles(scene)
    scene.render.engine = "CYCLES"
    show_colours(scene, "Raw" if as_trained else "Standard")
    splat_material()
    for tree in (*(material.node_tree for material in bpy.data.materials), *bpy.data.node_groups):
        if tree is not None and _LIGHT in tree.nodes:
            tree.nodes[_LIGHT].outputs[0].default_value = 0.0 if as_trained else 1.0


def prepare_cycles(scene: Any) -> None:
    """Sets what Cycles needs to show splats right, whether it is the scene's render engine now or will be chosen."""
    if scene.render.engine != "CYCLES":
        # Splats are smooth: many samples only cost time. They have no noise to remove, and not every build
        # has a denoiser.
        scene.cycles.samples, scene.cycles.preview_samples = SAMPLES, PREVIEW_SAMPLES
        scene.cycles.use_denoising = scene.cycles.use_preview_denoising = False
    scene.cycles.transparent_max_bounces = max(scene.cycles.transparent_max_bounces, TRANSPARENT_BOUNCES)
    scene.cycles.min_transparent_bounces = TRANSPARENT_BOUNCES


def show_colours(scene: Any, view_transform: str = "Standard") -> None:
    """Lets a scene show the photos' colours: any other view transform than these two changes them."""
    scene.view_settings.view_transform = view_transform
    scene.view_settings.look = "None"


def colours_fit(scene: Any) -> bool:
    """Whether the scene shows splats in the photos' colours: a twin that was appended brings no colour management."""
    trees = [material.node_tree for material in bpy.data.materials if material.name.startswith((NAME, CARD_NAME))]
    encoded = any(
        tree.nodes[_LIGHT].outputs[0].default_value == 0.0
        for tree in (*trees, *bpy.data.node_groups)
        if tree is not None and _LIGHT in tree.nodes
    )
    if scene.render.engine == OWN_ENGINE:
        encoded = False
    view = scene.view_settings
    shown_as_they_are = view.view_transform == ("Raw" if encoded else "Standard") and view.look == "None"
    return bool(shown_as_they_are and abs(view.exposure) < 1e-6 and abs(view.gamma - 1.0) < 1e-6)


def _output(graph: Graph, colour: Any, alpha: Any) -> None:
    """Light of this colour where the splat is, nothing where it is not."""
    emission = graph.node("ShaderNodeEmission", colour, 1.0).outputs[0]
    clear = graph.node("ShaderNodeBsdfTransparent").outputs[0]
    graph.node("ShaderNodeOutputMaterial", graph.node("ShaderNodeMixShader", alpha, clear, emission).outputs[0])


def _build() -> Any:
    material, graph = new_material(NAME)
    incoming = graph.node("ShaderNodeNewGeometry").outputs
    towards, back = incoming[4], incoming[6]
    alpha = graph.math("MULTIPLY", _alpha(graph, towards), graph.math("SUBTRACT", 1.0, back))
    _output(graph, linear_light(graph, _colour(graph, towards)), alpha)
    return material


def _alpha(graph: Graph, towards: Any) -> Any:
    place = graph.node("ShaderNodeTexCoord").outputs[3]
    turned = graph.node(
        "ShaderNodeVectorTransform", towards, vector_type="VECTOR", convert_from="WORLD", convert_to="OBJECT"
    ).outputs[0]
    ray = graph.vector("NORMALIZE", turned)
    across = graph.vector("CROSS_PRODUCT", place, ray)
    power = graph.math("MULTIPLY", graph.vector("DOT_PRODUCT", across, across), -0.5 * REACH**2)
    return graph.math("MULTIPLY", graph.math("EXPONENT", power), _attribute(graph, OPACITY, 2))


def _colour(graph: Graph, towards: Any) -> Any:
    """sRGB-encoded colour in the direction of view; twins without gloss lack its attributes (0)."""
    along = graph.vector("SCALE", towards, -1.0)
    slopes = [_attribute(graph, f"dgs_gloss_{name}", 1) for name in ("red", "green", "blue")]
    gloss = graph.node("ShaderNodeCombineXYZ", *(graph.vector("DOT_PRODUCT", s, along) for s in slopes)).outputs[0]
    return graph.vector("ADD", _attribute(graph, COLOUR, 1), gloss)


def linear_light(graph: Graph, encoded: Any) -> Any:
    """sRGB-encoded values in linear light, by the standard's two pieces; below 0 is 0. In any tree of nodes.

    The node named by `_LIGHT` fades from the encoded values (0) to linear light (1).
    """
    light = graph.node("ShaderNodeValue", name=_LIGHT, label=_LIGHT).outputs[0]
    light.default_value = 1.0
    channels = []
    for channel in graph.node("ShaderNodeSeparateXYZ", encoded).outputs:
        value = graph.math("MAXIMUM", channel, 0.0)
        curve = graph.math("POWER", graph.math("MULTIPLY_ADD", value, 1 / 1.055, 0.055 / 1.055), 2.4)
        straight = graph.math("MULTIPLY", value, 1 / 12.92)
        bright = graph.math("GREATER_THAN", value, 0.04045)
        step = graph.math("SUBTRACT", curve, straight)
        linear = graph.math("MULTIPLY_ADD", bright, step, straight)
        channels.append(graph.math("MULTIPLY_ADD", light, graph.math("SUBTRACT", linear, value), value))
    return graph.node("ShaderNodeCombineXYZ", *channels).outputs[0]


def _attribute(graph: Graph, name: str, output: int) -> Any:
    node = graph.node("ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name=name)
    return node.outputs[output]
