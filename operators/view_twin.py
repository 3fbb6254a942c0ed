"""Shows the twin in the 3D view as it renders."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.twin import scene_twin


class DGS_OT_view_twin(bpy.types.Operator):
    """Look through the scene's camera and show splats as they render; press again for the plain view"""

    bl_idname = "dgs.view_twin"
    bl_label = "View Twin"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin, a camera and a 3D view."""
        if scene_twin(context.scene, context.object) is None:
            reason = "There is no twin in this scene yet"
        elif context.scene.camera is None:
            reason = "The scene has no camera: import or add one"
        elif getattr(context.space_data, "type", "") != "VIEW_3D":
            reason = "This is no 3D view"
        else:
            reason = ""
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Changes the view, not the scene."""
        space = context.space_data
        shown = space.shading.type == "RENDERED" and space.region_3d.view_perspective == "CAMERA"
        space.shading.type = "SOLID" if shown else "RENDERED"
        space.region_3d.view_perspective = "PERSP" if shown else "CAMERA"
        # Outlines of thousands of splats, and the photo in front of them, hide what one wants to see.
        space.overlay.show_overlays = shown
        return {"FINISHED"}
