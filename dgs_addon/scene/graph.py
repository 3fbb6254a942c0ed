"""Short calls for building node trees, shader and geometry alike."""

from __future__ import annotations

from typing import Any

import bpy


def new_material(name: str) -> tuple[Any, Graph]:
    """A new `bpy` material without nodes, and its tree."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # always there from Blender 5 on
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, Graph(material.node_tree)


class Graph:
    """Adds nodes to a `bpy` node tree; inputs are sockets (linked) or values (set).

    Sockets are named by index: names differ between Blender's versions, positions do not.
    """

    def __init__(self, tree: Any) -> None:
        self.tree = tree
        self._count = 0

    def node(self, kind: str, *inputs: Any, **properties: Any) -> Any:
        """A node of type `kind`; None leaves an input as it is."""
        node = self.tree.nodes.new(kind)
        node.location = (200 * (self._count // 6), -220 * (self._count % 6))
        self._count += 1
        for name, value in properties.items():
            setattr(node, name, value)
        for index, value in enumerate(inputs):
            self.plug(node.inputs[index], value)
        return node

    def plug(self, socket: Any, value: Any) -> None:
        """Links a socket to `socket`, or sets its value."""
        if value is None:
            return
        if hasattr(value, "is_linked"):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def math(self, operation: str, *inputs: Any) -> Any:
        """The number that `operation` makes of one to three inputs."""
        return self.node("ShaderNodeMath", *inputs, operation=operation).outputs[0]

    def vector(self, operation: str, *inputs: Any) -> Any:
        """The vector that `operation` makes of its inputs; DOT_PRODUCT and LENGTH give a number."""
        node = self.node("ShaderNodeVectorMath", operation=operation)
        for index, value in enumerate(inputs):
            # SCALE takes its factor in the fourth socket.
            self.plug(node.inputs[3 if operation == "SCALE" and index == 1 else index], value)
        return node.outputs[1 if operation in ("DOT_PRODUCT", "LENGTH") else 0]

    def named(self, kind: str, name: str) -> Any:
        """A named attribute of the geometry, as a field of data type `kind`."""
        node = self.node("GeometryNodeInputNamedAttribute", name, data_type=kind)
        return next(socket for socket in node.outputs if socket.enabled)

    def store(self, geometry: Any, kind: str, name: str, value: Any) -> Any:
        """`geometry` with a named attribute on its points."""
        node = self.node("GeometryNodeStoreNamedAttribute", geometry, None, name, data_type=kind, domain="POINT")
        self.plug(next(s for s in node.inputs if s.name == "Value" and s.enabled), value)
        return node.outputs[0]
