"""Limits how many splats a render shows."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.nodes import COUNT_INPUT, set_splat_input, splat_input, splat_modifier
from ..dgs_addon.scene.twin import scene_twin


class DGS_OT_limit_splats(bpy.types.Operator):
    """Set the largest number of splats that a render shows, beginning with all that this twin has"""

    bl_idname = "dgs.limit_splats"
    bl_label = "Limit Number"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin whose modifier has the input."""
        twin = scene_twin(context.scene, context.object)
        modifier = splat_modifier(twin) if twin is not None else None
        cls.poll_message_set("There is no twin in this scene yet")
        return modifier is not None and splat_input(modifier, COUNT_INPUT) is not None

    def execute(self, context: Any) -> set[str]:
        """All splats, as a number that can be lowered."""
        twin = scene_twin(context.scene, context.object)
        set_splat_input(splat_modifier(twin), COUNT_INPUT, len(twin.data.vertices))
        return {"FINISHED"}
