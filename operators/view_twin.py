"""Shows the twin in the 3D view as it renders."""

from __future__ import annotations

from typing import Any

import bpy


class DGS_OT_view_twin(bpy.types.Operator):
    """Look through the scene's camera and show splats as they render; press again for the plain view"""

    bl_idname = "dgs.view_twin"
    bl_label = "View Twin"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a 3D view and a camera."""
        cls.poll_message_set("The scene has no camera, or there is no 3D view here")
        return context.scene.camera is not None and getattr(context.space_data, "type", "") == "VIEW_3D"

    def execute(self, context: Any) -> set[str]:
        """Changes the view, not the scene."""
        space = context.space_data
        shown = space.shading.type == "RENDERED" and space.region_3d.view_perspective == "CAMERA"
        space.shading.type = "SOLID" if shown else "RENDERED"
        space.region_3d.view_perspective = "PERSP" if shown else "CAMERA"
        # Outlines of thousands of splats, and the photo in front of them, hide what one wants to see.
        space.overlay.show_overlays = shown
        return {"FINISHED"}
