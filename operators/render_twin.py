"""Renders the twin through the scene's camera."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.changes import noting
from ..dgs_addon.scene.material import OWN_ENGINE
from ..dgs_addon.scene.setting_up import set_up_scene
from ..dgs_addon.scene.twin import why_no_picture


class DGS_OT_render_twin(bpy.types.Operator):
    """Render the scene through its camera, with a render engine that shows splats right"""

    bl_idname = "dgs.render_twin"
    bl_label = "Render Twin"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin and a camera."""
        reason = why_no_picture(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Renders; with a window, into Blender's own render window."""
        scene = context.scene
        if scene.render.engine not in ("CYCLES", OWN_ENGINE):
            with noting(scene):
                set_up_scene(scene)
        if bpy.app.background:
            return bpy.ops.render.render()
        return bpy.ops.render.render("INVOKE_DEFAULT")
