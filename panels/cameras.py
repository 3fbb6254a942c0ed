"""Step 2: where the photos were taken from."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.data_sets import came_with_photos
from ..dgs_addon.job.steps import cameras_found, results
from .layout import Step, figures, folded, ready, sentence, split


class DGS_PT_cameras(Step, bpy.types.Panel):
    """Which cameras."""

    bl_idname = "DGS_PT_cameras"
    bl_label = "2  Cameras"

    def draw_header_preset(self, context: Any) -> None:
        """Done once they are found or given."""
        ready(self.layout, cameras_found(context.scene) or context.scene.dgs.cameras != "photos")

    def draw(self, context: Any) -> None:
        """Where they come from, how many were placed."""
        layout, settings = split(self.layout), context.scene.dgs
        layout.prop(settings, "cameras", text="Source")
        if settings.cameras == "model":
            layout.prop(settings, "model")
            if came_with_photos(settings):
                sentence(layout, context, "They came with the photos", "CHECKMARK")
        elif settings.cameras == "scene":
            sentence(layout, context, "Cameras of this scene that are named as the photos are", "INFO")
        else:
            layout.operator("dgs.find_cameras", icon="VIEW_CAMERA", text="Find Cameras")
            self._state(layout, context)
        layout.operator("dgs.show_cameras", icon="OUTLINER_OB_CAMERA")
        body = folded(layout, "cameras", "More")
        if body is not None:
            body.prop(settings, "adjust_cameras")
            body.prop(settings, "refine_cameras")

    def _state(self, layout: Any, context: Any) -> None:
        held = results(context.scene)
        if not cameras_found(context.scene):
            sentence(layout, context, "Not found yet; Optimize finds them too", "INFO")
        elif held.record is not None and "registered" in held.record.result:
            figures(layout, "{count} photos registered", "CHECKMARK", count=held.record.result["registered"])
        else:
            layout.label(text="Found", icon="CHECKMARK")
