"""Step 5, folded: the twin's splats, cleaned up."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.twin import is_twin
from .layout import Sidebar, figures, split


class DGS_PT_twin_edit(Sidebar, bpy.types.Panel):
    """Selecting, deleting, hiding, merging."""

    bl_idname = "DGS_PT_twin_edit"
    bl_label = "Edit"
    bl_parent_id = "DGS_PT_twin"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Shown for twins only."""
        return is_twin(context.object)

    def draw(self, context: Any) -> None:
        """Buttons in the order in which they are used."""
        layout = split(self.layout)
        edited = context.mode == "EDIT_MESH"
        name = "Back to Object Mode" if edited else "Edit Splats"
        layout.operator("dgs.edit_splats", text=name, icon="EDITMODE_HLT", depress=edited)
        if edited:
            selected = sum(thing.data.total_vert_sel for thing in context.objects_in_mode_unique_data)
            figures(layout, "{count:,} splats are selected", "RESTRICT_SELECT_OFF", count=selected)
        column = layout.column(align=True)
        column.operator("dgs.select_floaters", icon="STICKY_UVS_DISABLE")
        for kind in ("size", "opacity", "colour", "error"):
            column.operator(f"dgs.select_by_{kind}")
        row = layout.row(align=True)
        row.operator("dgs.delete_splats", text="Delete", icon="TRASH")
        row.operator("dgs.hide_splats", text="Hide", icon="HIDE_ON")
        column = layout.column(align=True)
        column.operator("dgs.show_splats", icon="HIDE_OFF")
        column.operator("dgs.restore_splats", icon="LOOP_BACK")
        column = layout.column(align=True)
        column.operator("dgs.merge_twins", icon="AUTOMERGE_ON")
        column.operator("dgs.apply_transform", icon="FREEZE")
