"""Limits what is shown of a twin to a box."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.crop import add_crop_box, crop_box
from ..dgs_addon.scene.nodes import BOX_INPUT, splat_input, splat_modifier
from ..dgs_addon.scene.twin import scene_twin


class DGS_OT_crop_twin(bpy.types.Operator):
    """Add an empty cube around the twin: only the splats inside are shown. Move, turn and scale it as any object"""

    bl_idname = "dgs.crop_twin"
    bl_label = "Add Crop Box"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin without a box."""
        twin = scene_twin(context.scene, context.object)
        modifier = splat_modifier(twin) if twin is not None else None
        if twin is None:
            reason = "There is no twin in this scene yet"
        elif modifier is None or splat_input(modifier, BOX_INPUT) is None:
            reason = "The twin's modifier has no input for a box: import the twin again"
        elif crop_box(twin) is not None:
            reason = "The twin has a crop box already: move it, or switch cropping off"
        else:
            reason = ""
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Adds the cube and selects it; the twin stays active, so that its panel stays in view."""
        twin = scene_twin(context.scene, context.object)
        box = add_crop_box(twin, twin.users_collection[0])
        for other in context.selected_objects:
            other.select_set(False)
        box.select_set(True)
        context.view_layer.objects.active = twin
        return {"FINISHED"}
