"""Makes the engine's own picture of the twin."""

from __future__ import annotations

import time
from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions import exact
from ..dgs_addon.scene.twin import scene_twin
from ..dgs_addon.window import redraw, redraw_views


class DGS_OT_exact_view(bpy.types.Operator):
    """Let the engine draw the twin through the scene's camera, sharp or through the medium, into an image"""

    bl_idname = "dgs.exact_view"
    bl_label = "Exact View"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin, a camera and an engine."""
        reason = why_no_view(context)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        twin = scene_twin(context.scene, context.object)
        try:
            view = exact.start(twin, context.scene, show_exact_view)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        if not bpy.app.background:
            return {"FINISHED"}
        while not view.ended:
            view.drain()
            time.sleep(0.02)
        if view.error:
            self.report({"ERROR"}, in_users_language(view.error))
            return {"CANCELLED"}
        return {"FINISHED"}


def why_no_view(context: Any) -> str:
    """Why no exact view can be made now; '' if one can."""
    camera = context.scene.camera
    if scene_twin(context.scene, context.object) is None:
        reason = "There is no twin in this scene yet (step 5)"
    elif camera is None or camera.type != "CAMERA" or camera.data.type != "PERSP":
        reason = "The scene needs a perspective camera"
    elif exact.busy():
        reason = "The engine is drawing already"
    else:
        reason = why_not()
    return reason


def show_exact_view(view: exact.ExactView) -> None:
    """Shows the image in the panel, and in image editors that show nothing else of the user's."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR" and view.image is not None:
                shown = area.spaces.active.image
                if shown is None or shown.type == "RENDER_RESULT":
                    area.spaces.active.image = view.image
    windows = bpy.context.window_manager.windows
    if windows and view.image is not None and not bpy.app.background:  # else the next undo would take it out again
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.ed.undo_push(message="Descatter Exact View")
    redraw()
    redraw_views()
    if view.error:

        def draw(menu: Any, _context: Any) -> None:
            menu.layout.label(text=view.error)

        bpy.context.window_manager.popup_menu(draw, title="Exact View", icon="ERROR")
