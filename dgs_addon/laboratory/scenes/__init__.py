"""Scenes of the laboratory besides the ball: for sets that no number of the engine was chosen on.

A scene is a module with `build(seed)`, which empties Blender's file and builds it in metres, z up. Its middle and size
(for the camera paths) stand in `SCENES`, which loads no bpy.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class BuiltScene:
    """Where cameras look, and how far away they are.

    Attributes:
        middle: [3] what the paths are laid out around, in Blender's world, metres.
        size: how many times larger than the ball the scene is; distances grow with it.
        alone: whether it is one object with nothing around it.
        ground: metres, below which no camera stands; minus infinity where nothing bounds the scene from below.
    """

    middle: tuple[float, float, float]
    size: float
    alone: bool = False
    ground: float = -inf


#: By name; each is built by the module of its name.
SCENES = {
    "orrery": BuiltScene((0.0, 0.0, 0.0), 1.0, alone=True),
    "plant": BuiltScene((0.0, 0.0, 0.0), 1.0, alone=True),
    "room": BuiltScene((0.0, 0.0, 1.3), 20.0),
    "shelf": BuiltScene((0.0, 0.0, 0.95), 4.0),
    "village": BuiltScene((0.0, 0.0, 2.0), 60.0, ground=3.0),
}
