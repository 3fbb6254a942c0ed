"""The sky of a built scene: one colour from all sides."""

from __future__ import annotations

from typing import Any

import bpy


def add_sky(scene: Any, name: str, colour: tuple[float, float, float], strength: float) -> None:
    """Gives a scene a world of its own.

    Args:
        colour: linear RGB; strength: factor on it.
    """
    world = bpy.data.worlds.new(name)
    if world.node_tree is None:
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs[0].default_value = (*colour, 1.0)
    background.inputs[1].default_value = strength
    scene.world = world
