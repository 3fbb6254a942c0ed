"""Shows what has changed of a twin, or the twin itself."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.comparison import changed_mesh, show_changes, shows_changes
from ..dgs_addon.scene.twin import is_twin
from ..dgs_addon.window import redraw_views


class DGS_OT_show_changes(bpy.types.Operator):
    """Show what has changed, coloured, in the place of the twin. Again: the twin"""

    bl_idname = "dgs.show_changes"
    bl_label = "Show Changes"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The active twin was compared, and the mesh is there."""
        cls.poll_message_set("Select a twin, and compare it with an earlier one")
        return is_twin(context.object) and changed_mesh(context.object) is not None

    def execute(self, context: Any) -> set[str]:
        """Switches."""
        show_changes(context.object, not shows_changes(context.object), context.scene)
        redraw_views()
        return {"FINISHED"}
