"""Step 5: the twin in the scene, and how it looks."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.drawing.live import SHOWN
from ..dgs_addon.drawing.render_engine import ENGINE
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.paths import out_folder
from ..dgs_addon.questions import next_views
from ..dgs_addon.scene.crop import crop_box
from ..dgs_addon.scene.material import colours_fit
from ..dgs_addon.scene.nodes import (
    BOX_INPUT,
    COUNT_INPUT,
    CROP_INPUT,
    FACE_INPUT,
    SIZE_INPUT,
    THRESHOLD_INPUT,
    UNLIMITED,
    VIEWPORT_INPUT,
    splat_input,
    splat_modifier,
    splat_value,
)
from ..dgs_addon.scene.twin import is_twin
from .layout import Sidebar, Step, figures, folded, ready, sentence, split


class DGS_PT_twin(Step, bpy.types.Panel):
    """In and out."""

    bl_idname = "DGS_PT_twin"
    bl_label = "5  Twin"

    def draw_header_preset(self, context: Any) -> None:
        """Done once a twin is in the scene."""
        ready(self.layout, any(is_twin(thing) for thing in context.scene.objects))

    def draw(self, context: Any) -> None:
        """What is selected, and the ways in and out."""
        layout = split(self.layout)
        layout.operator("dgs.add_results", icon="ADD")
        layout.operator("dgs.view_twin", icon="HIDE_OFF")
        twin = context.object
        if is_twin(twin):
            figures(
                layout, "{name}: {count:,} splats", "POINTCLOUD_DATA", name=twin.name, count=len(twin.data.vertices)
            )
        else:
            layout.label(text="No twin is selected", icon="INFO")
        if any(is_twin(thing) for thing in context.scene.objects) and not colours_fit(context.scene):
            text = "The scene's colour management ('{name}') changes the photos' colours"
            sentence(layout, context, text, "ERROR", name=context.scene.view_settings.view_transform)
            if context.scene.render.engine == ENGINE:
                layout.prop(context.scene.view_settings, "view_transform")
            else:
                layout.operator("dgs.prepare_scene", icon="COLOR").blending = "LIGHT"
        column = layout.column(align=True)
        column.operator("dgs.show_known", icon="COLOR")
        column.operator("dgs.suggest_next_views", icon="OUTLINER_OB_CAMERA")
        column.operator("dgs.show_next_views", icon="CAMERA_DATA")
        _draw_search(layout, context)
        body = folded(layout, "update", "New Photos")
        if body is not None:
            body.prop(context.scene.dgs, "new_photos", text="Folder")
            body.prop(context.scene.dgs, "watching")
            column = body.column(align=True)
            column.operator("dgs.update_twin", icon="FILE_REFRESH")
            column.operator("dgs.rollback_twin", icon="LOOP_BACK")
            column.operator("dgs.show_states", icon="TIME")
        body = folded(layout, "place", "Size and Up")
        if body is not None:
            body.prop(context.scene.dgs, "known_length")
            body.operator("dgs.set_length", icon="DRIVER_DISTANCE")
            body.operator("dgs.set_up", icon="ORIENTATION_NORMAL")
        body = folded(layout, "twin", "Files")
        if body is not None:
            column = body.column(align=True)
            column.operator("dgs.import_twin", text="Import Twin", icon="IMPORT")
            column.operator("dgs.export_twin", text="Export Twin", icon="EXPORT")
            column.operator("dgs.import_cameras", text="Import Cameras", icon="CAMERA_DATA")


def _draw_search(layout: Any, context: Any) -> None:
    """Whether the engine looks for views, and why it found none."""
    if next_views.question.running:
        layout.label(text="Looking for views...", icon="TIME")
    elif next_views.question.error and next_views.question.subject == (str(out_folder(context.scene.dgs)),):
        sentence(layout, context, in_users_language(next_views.question.error), "ERROR")


class DGS_PT_twin_look(Sidebar, bpy.types.Panel):
    """The active twin's controls."""

    bl_idname = "DGS_PT_twin_look"
    bl_label = "Display"
    bl_parent_id = "DGS_PT_twin"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Shown for twins only."""
        return is_twin(context.object) and splat_modifier(context.object) is not None

    def draw(self, context: Any) -> None:
        """The modifier's inputs and the render set-up."""
        layout = split(self.layout)
        modifier = splat_modifier(context.object)
        column = layout.column()
        for name in (SIZE_INPUT, THRESHOLD_INPUT, COUNT_INPUT, VIEWPORT_INPUT, FACE_INPUT):
            place = splat_input(modifier, name)
            if name == COUNT_INPUT and (splat_value(modifier, name) or 0) >= UNLIMITED:
                column.operator("dgs.limit_splats")  # a number of nine digits says less
            elif place is not None:
                # The whole name is cut off where the sidebar is as wide as it usually is.
                column.prop(*place, text="Min Opacity" if name == THRESHOLD_INPUT else name)
        if crop_box(context.object) is None:
            layout.operator("dgs.crop_twin", icon="CUBE")
        else:
            for name, text in ((CROP_INPUT, CROP_INPUT), (BOX_INPUT, "Box")):
                place = splat_input(modifier, name)
                if place is not None:
                    column.prop(*place, text=text)
        layout.prop(context.scene, SHOWN)
        if context.scene.render.engine not in ("CYCLES", ENGINE):
            sentence(layout, context, "Splats look right in Cycles and Descatter only", "ERROR")
        row = layout.row(align=True)
        row.operator("dgs.prepare_scene", text="Blend as Light").blending = "LIGHT"
        row.operator("dgs.prepare_scene", text="As Trained").blending = "TRAINED"
        layout.operator("dgs.composite_meshes", icon="NODE_COMPOSITING")
