"""Shows the twin in the 3D view as the engine sees it."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.drawing.live import SHOWN
from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.scene.material import OWN_ENGINE
from ..dgs_addon.scene.twin import scene_twin


class DGS_OT_view_twin(bpy.types.Operator):
    """Look through the scene's camera at the splats alone, as the engine sees them; press again for the plain view"""

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
        shown = space.region_3d.view_perspective == "CAMERA" and not space.overlay.show_overlays
        space.shading.type = "SOLID" if shown else _mode(context.scene)
        space.region_3d.view_perspective = "PERSP" if shown else "CAMERA"
        # Outlines, cameras, and the photo in front of the splats hide what one wants to see.
        space.overlay.show_overlays = shown
        return {"FINISHED"}


def _mode(scene: Any) -> str:
    """The way of drawing in which splats are what the engine sees, and come at once."""
    live = getattr(scene, SHOWN, True) and not why_not()
    return "SOLID" if live and scene.render.engine != OWN_ENGINE else "RENDERED"
