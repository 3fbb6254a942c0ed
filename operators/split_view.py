"""Compares the exact view with photos in the camera's frame of the 3D view; the line between them can be dragged."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions import exact, split_view
from ..dgs_addon.scene.twin import scene_twin
from .exact_view import show_exact_view, why_no_view

#: Px beside the line, at a scale of 1, where it can still be grasped.
_NEAR = 10.0


class DGS_OT_split_view(bpy.types.Operator):
    """Look through the scene's camera at the exact view beside the photo; press again for the plain view"""

    bl_idname = "dgs.split_view"
    bl_label = "Compare in View"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """It is shown, or there are a twin, a camera, an engine and a 3D view."""
        reason = "" if context.scene.dgs.split_shown else why_no_view(context)
        if not reason and getattr(context.space_data, "type", "") != "VIEW_3D":
            reason = "This is no 3D view"
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Makes the pictures where there are none of this view yet."""
        settings, view = context.scene.dgs, context.space_data.region_3d
        settings.split_shown = not settings.split_shown
        if not settings.split_shown:
            return {"FINISHED"}
        view.view_perspective = "CAMERA"
        twin = scene_twin(context.scene, context.object)
        if settings.exact_view is None or exact.is_outdated(twin, context.scene):
            try:
                exact.start(twin, context.scene, show_exact_view)
            except DgsError as error:
                self.report({"ERROR"}, in_users_language(str(error)))
                return {"CANCELLED"}
        return {"FINISHED"}


class DGS_GT_split(bpy.types.Gizmo):
    """The line between two pictures; `split_view` draws it."""

    bl_idname = "DGS_GT_split"
    __slots__ = ("before",)

    def draw(self, _context: Any) -> None:
        """Nothing: it is part of the pictures."""

    def test_select(self, context: Any, location: Any) -> int:
        """0 where the mouse (px of the region) is at the line, else -1."""
        frame = split_view.frame_of(context)
        if frame is None:
            return -1
        left, bottom, right, top = frame
        line = left + context.scene.dgs.split_at * (right - left)
        near = abs(location[0] - line) <= _NEAR * context.preferences.system.ui_scale
        return 0 if near and bottom <= location[1] <= top else -1

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """The button goes down."""
        self.before = context.scene.dgs.split_at
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any, _tweak: Any) -> set[str]:
        """The mouse moves."""
        frame = split_view.frame_of(context)
        if frame is not None:
            share = (event.mouse_region_x - frame[0]) / max(frame[2] - frame[0], 1e-6)
            context.scene.dgs.split_at = min(max(share, 0.0), 1.0)
        return {"RUNNING_MODAL"}

    def exit(self, context: Any, cancel: bool) -> None:
        """The button goes up, or Escape puts the line back."""
        if cancel:
            context.scene.dgs.split_at = self.before


class DGS_GGT_split(bpy.types.GizmoGroup):
    """What can be dragged while pictures are compared."""

    bl_idname = "DGS_GGT_split"
    bl_label = "Descatter Comparison"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Pictures are compared in this view."""
        return split_view.shown(context)

    def setup(self, _context: Any) -> None:
        """The line."""
        line = self.gizmos.new(DGS_GT_split.bl_idname)
        line.use_draw_modal = True
