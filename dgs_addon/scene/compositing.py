"""Twins and meshes in one final picture: each rendered by the engine that can, put together by depth.

A render engine belongs to a scene, so that twins get a scene of their own (the same objects, the same camera) that
Descatter renders; Cycles or EEVEE renders the meshes. Blender renders both for the compositor of the meshes' scene, and
that puts one over the other, px by px, by the depths of what is seen:

    twin nearer:  twin over meshes        meshes nearer:  meshes over twin        (colours multiplied by alpha)

A mesh that is a holdout leaves no depth. It goes into the twins' scene, too: there Descatter holds out what is behind.

In 3D views nothing changes: twins stay in the scene, and only its renders leave them to the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

from .graph import Graph
from .material import OWN_ENGINE, show_colours
from .twin import is_twin

#: The node group, and the collection of twins that the meshes' scene does not render.
GROUP, COLLECTION = "Descatter Depth Composite", "Descatter Twins"
#: Scene property of the twins' scene: whose twins it renders.
TWINS_OF = "dgs_twins_of"
#: The collection of the twins' scene with the meshes' holdouts.
HOLDOUTS = "Descatter Holdouts"
_NODE = "Descatter Composite"
#: Sockets of the group.
_INPUTS = (("Meshes", "Color"), ("Meshes Depth", "Float"), ("Twin", "Color"), ("Twin Depth", "Float"))
_OUTPUTS = (("Image", "Color"), ("Depth", "Float"))


def composite(scene: Any, engine: str) -> Any:
    """Sets a scene up so that its final pictures show its twins among its meshes; once more: takes in new twins.

    Args:
        scene: `bpy` scene with twins and a camera.
        engine: the render engine of its meshes.

    Returns:
        The twins' scene.
    """
    twins = [thing for thing in scene.objects if is_twin(thing)]
    scene.render.engine = engine
    scene.render.film_transparent = scene.render.use_compositing = True
    for layer in scene.view_layers:
        layer.use_pass_z = True
    other = _scene_of_twins(scene, twins)
    _leave_out(scene, twins)
    _connect(scene, other)
    return other


def twins_scene(scene: Any) -> Any:
    """The scene that renders this one's twins; None if there is none."""
    return next((other for other in bpy.data.scenes if other.get(TWINS_OF) == scene), None)


def leave_twins_scene(twin: Any, scene: Any) -> None:
    """A twin that is to leave a scene is no more in the one that renders its twins."""
    other = twins_scene(scene)
    if other is not None and twin.name in other.collection.objects:
        other.collection.objects.unlink(twin)


def _scene_of_twins(scene: Any, twins: Sequence[Any]) -> Any:
    other = twins_scene(scene)
    if other is None:
        other = bpy.data.scenes.new(f"{scene.name} Twins")
        other[TWINS_OF] = scene
    for thing in list(other.collection.objects):
        if thing not in twins:
            other.collection.objects.unlink(thing)
    for twin in twins:
        if twin.name not in other.collection.objects:
            other.collection.objects.link(twin)
    _take_holdouts(scene, other)
    other.camera, other.render.engine = scene.camera, OWN_ENGINE
    other.render.film_transparent = True
    show_colours(other)
    for layer in other.view_layers:
        # Wherever a twin is seen at all it has a depth: its soft edges, too, lie before something or behind it.
        layer.use_pass_z, layer.pass_alpha_threshold = True, 0.0
    return other


def _take_holdouts(scene: Any, other: Any) -> None:
    """All that holds something out of the scene's pictures holds twins out, too."""
    layer = scene.view_layers[0]
    things = [t for t in scene.objects if not is_twin(t) and (t.is_holdout or t.holdout_get(view_layer=layer))]
    inside = next((child for child in other.collection.children if child.get(TWINS_OF)), None)
    if inside is None:
        if not things:
            return
        inside = bpy.data.collections.new(HOLDOUTS)
        inside[TWINS_OF] = True
        other.collection.children.link(inside)
    for thing in [t for t in inside.objects if t not in things]:
        inside.objects.unlink(thing)
    for thing in [t for t in things if t.name not in inside.objects]:
        inside.objects.link(thing)
    for layer in other.view_layers:
        layer.layer_collection.children[inside.name].holdout = True


def _leave_out(scene: Any, twins: Sequence[Any]) -> None:
    """Moves the twins into a collection that final pictures of the scene do not show."""
    collection = next((c for c in scene.collection.children if c.get(TWINS_OF)), None)
    if collection is None:
        collection = bpy.data.collections.new(COLLECTION)
        collection[TWINS_OF] = collection.hide_render = True
        scene.collection.children.link(collection)
    inside = {scene.collection, *scene.collection.children_recursive}
    for twin in twins:
        if twin.name not in collection.objects:
            collection.objects.link(twin)
        for former in [c for c in twin.users_collection if c in inside and c != collection]:
            former.objects.unlink(twin)


def _connect(scene: Any, other: Any) -> None:
    """Puts the group into the scene's compositor, in the place of its own picture."""
    tree, output = _tree(scene)
    if any(node.name.startswith(_NODE) for node in tree.nodes):
        return
    graph = Graph(tree)
    own = next((n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers" and n.scene in (scene, None)), None)
    if own is None:
        own = graph.node("CompositorNodeRLayers", scene=scene)
    fed = [link.to_socket for link in tree.links if link.from_node == own and link.from_socket.name == "Image"]
    twins = graph.node("CompositorNodeRLayers", scene=other, name=f"{_NODE} Twins", label="Twins")
    group = graph.node("CompositorNodeGroup", node_tree=depth_composite(), name=_NODE, label=GROUP)
    for node, names in ((own, ("Meshes", "Meshes Depth")), (twins, ("Twin", "Twin Depth"))):
        for output_name, name in zip(("Image", "Depth"), names, strict=True):
            tree.links.new(node.outputs[output_name], group.inputs[name])
    for socket in fed or [output]:
        tree.links.new(group.outputs["Image"], socket)
    for node, place in ((own, (-300, 200)), (twins, (-300, -200)), (group, (50, 0))):
        node.location = place


def _tree(scene: Any) -> tuple[Any, Any]:
    """The scene's compositor, which is made if there is none, and the socket of its picture."""
    if hasattr(scene, "compositing_node_group"):  # from Blender 5 on
        tree = scene.compositing_node_group
        if tree is None:
            tree = scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        if not any(item.in_out == "OUTPUT" for item in tree.interface.items_tree if item.item_type == "SOCKET"):
            tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        kind = "NodeGroupOutput"
    else:
        scene.use_nodes, kind = True, "CompositorNodeComposite"
        tree = scene.node_tree
    node = next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)
    node.location = (350, 0)
    return tree, node.inputs[0]


def depth_composite() -> Any:
    """The node group: two pictures with depths, the nearer over the other."""
    existing = bpy.data.node_groups.get(GROUP)
    if existing is not None:
        return existing
    tree = bpy.data.node_groups.new(GROUP, "CompositorNodeTree")
    for in_out, sockets in (("INPUT", _INPUTS), ("OUTPUT", _OUTPUTS)):
        for name, kind in sockets:
            tree.interface.new_socket(name, in_out=in_out, socket_type=f"NodeSocket{kind}")
    graph = Graph(tree)
    meshes, meshes_depth, twin, twin_depth = graph.node("NodeGroupInput").outputs[:4]
    front = _math(graph, "LESS_THAN", twin_depth, meshes_depth)
    behind = _math(graph, "SUBTRACT", 1.0, front)
    below = _over(graph, behind, (0.0, 0.0, 0.0, 0.0), twin)
    image = _over(graph, front, _over(graph, 1.0, below, meshes), twin)
    graph.node("NodeGroupOutput", image, _math(graph, "MINIMUM", twin_depth, meshes_depth))
    return tree


def _math(graph: Graph, operation: str, first: Any, second: Any) -> Any:
    kind = "ShaderNodeMath" if bpy.app.version >= (5, 0) else "CompositorNodeMath"
    return graph.node(kind, first, second, operation=operation).outputs[0]


def _over(graph: Graph, factor: Any, below: Any, above: Any) -> Any:
    """`above` over `below`, both multiplied by alpha; of `above` only as much as `factor` says."""
    node = graph.node("CompositorNodeAlphaOver")
    places = ("Fac", "Background", "Foreground") if bpy.app.version >= (5, 0) else ("Fac", "Image", "Image_001")
    sockets = {socket.identifier: socket for socket in node.inputs}
    for place, value in zip(places, (factor, below, above), strict=True):
        graph.plug(sockets[place], value)
    return node.outputs[0]
