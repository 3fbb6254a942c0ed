"""Twin and cameras in, and how the active twin looks."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.nodes import (
    COUNT_INPUT,
    FACE_INPUT,
    SIZE_INPUT,
    THRESHOLD_INPUT,
    VIEWPORT_INPUT,
    splat_modifier,
)
from ..dgs_addon.scene.twin import is_twin


class DGS_PT_twin(bpy.types.Panel):
    """Imports."""

    bl_idname = "DGS_PT_twin"
    bl_label = "Twin"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Descatter"

    def draw(self, context: Any) -> None:
        """Draws the import buttons and says what is selected."""
        column = self.layout.column(align=True)
        column.operator("dgs.import_twin", text="Import Twin", icon="IMPORT")
        column.operator("dgs.import_cameras", text="Import Cameras", icon="CAMERA_DATA")
        twin = context.object
        if is_twin(twin):
            self.layout.label(text=f"{twin.name}: {len(twin.data.vertices):,} splats", icon="POINTCLOUD_DATA")
        else:
            self.layout.label(text="No twin selected", icon="INFO")


class DGS_PT_twin_look(bpy.types.Panel):
    """The active twin's controls."""

    bl_idname = "DGS_PT_twin_look"
    bl_label = "Look"
    bl_parent_id = "DGS_PT_twin"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Descatter"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Shown for twins only."""
        return is_twin(context.object) and splat_modifier(context.object) is not None

    def draw(self, context: Any) -> None:
        """Draws the modifier's inputs and the render set-up."""
        layout = self.layout
        layout.use_property_split = True
        modifier = splat_modifier(context.object)
        sockets = {item.name: item.identifier for item in modifier.node_group.interface.items_tree}
        column = layout.column()
        for name in (SIZE_INPUT, THRESHOLD_INPUT, COUNT_INPUT, VIEWPORT_INPUT, FACE_INPUT):
            if name in sockets:
                column.prop(modifier, f'["{sockets[name]}"]', text=name)
        if context.scene.render.engine != "CYCLES":
            layout.label(text="Splats look right in Cycles only", icon="ERROR")
        row = layout.row(align=True)
        row.operator("dgs.prepare_scene", text="Blend as Light").blending = "LIGHT"
        row.operator("dgs.prepare_scene", text="As Trained").blending = "TRAINED"
