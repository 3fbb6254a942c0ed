"""Edits a twin's splats: into Edit Mode, delete, hide, show, bring back."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.scene.restoring import Missing, missing_splats, restore
from ..dgs_addon.scene.selection import read_splats
from ..dgs_addon.scene.sources import read_sources
from ..dgs_addon.scene.twin import is_twin
from .select_splats import edited_twins


class DGS_OT_edit_splats(bpy.types.Operator):
    """Go to Edit Mode, where Blender's own tools select splats by box, lasso or circle. Again: back to Object Mode"""

    bl_idname = "dgs.edit_splats"
    bl_label = "Edit Splats"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active."""
        cls.poll_message_set("Select a twin first")
        return is_twin(context.object) and context.mode in ("OBJECT", "EDIT_MESH")

    def execute(self, context: Any) -> set[str]:
        """Switches."""
        if context.mode == "EDIT_MESH":
            bpy.ops.object.mode_set(mode="OBJECT")
        else:
            edited_twins(context)
        return {"FINISHED"}


class _OfTheSelection:
    """What is done with selected splats."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is in Edit Mode."""
        cls.poll_message_set("Select splats in Edit Mode first")  # type: ignore[attr-defined]
        return is_twin(context.object) and context.mode == "EDIT_MESH"


def _selected(context: Any) -> int:
    return sum(thing.data.total_vert_sel for thing in edited_twins(context))


class DGS_OT_delete_splats(_OfTheSelection, bpy.types.Operator):
    """Delete the selected splats. 'Restore Deleted' brings them back from the twin's file, also after saving"""

    bl_idname = "dgs.delete_splats"
    bl_label = "Delete Splats"

    def execute(self, context: Any) -> set[str]:
        """Deletes; says how many."""
        count = _selected(context)
        if not count:
            self.report({"WARNING"}, rpt_("No splat is selected"))
            return {"CANCELLED"}
        bpy.ops.mesh.delete(type="VERT")
        self.report({"INFO"}, rpt_("{count:,} splats deleted").format(count=count))
        return {"FINISHED"}


class DGS_OT_hide_splats(_OfTheSelection, bpy.types.Operator):
    """Hide the selected splats, in Edit Mode, in all pictures, and in exports of what is shown"""

    bl_idname = "dgs.hide_splats"
    bl_label = "Hide Splats"

    unselected: bpy.props.BoolProperty(name="Unselected", description="Hide all others instead")  # type: ignore[valid-type]

    def execute(self, context: Any) -> set[str]:
        """Hides; says how many are hidden now."""
        bpy.ops.mesh.hide(unselected=self.unselected)
        hidden = sum(int(read_splats(twin).hidden.sum()) for twin in edited_twins(context))
        self.report({"INFO"}, rpt_("{count:,} splats hidden").format(count=hidden))
        return {"FINISHED"}


class DGS_OT_show_splats(_OfTheSelection, bpy.types.Operator):
    """Show and select the splats that were hidden"""

    bl_idname = "dgs.show_splats"
    bl_label = "Show Hidden"

    def execute(self, context: Any) -> set[str]:
        """Shows; says how many."""
        hidden = sum(int(read_splats(twin).hidden.sum()) for twin in edited_twins(context))
        bpy.ops.mesh.reveal()
        self.report({"INFO"}, rpt_("{count:,} splats shown again").format(count=hidden))
        return {"FINISHED"}


class DGS_OT_restore_splats(bpy.types.Operator):
    """Bring back all deleted splats from the files that the twin came from. What was done to the others stays"""

    bl_idname = "dgs.restore_splats"
    bl_label = "Restore Deleted"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The active twin came from files of which it has kept the names."""
        cls.poll_message_set("Select a twin first")
        if not is_twin(context.object) or context.mode not in ("OBJECT", "EDIT_MESH"):
            return False
        cls.poll_message_set("This twin does not say which file it came from: import it again")
        return bool(read_sources(context.object.data))

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Says how many, and asks."""
        missing = self._missing(context)
        if missing is None:
            return {"CANCELLED"}
        words = rpt_("Bring back {count:,} deleted splats?").format(count=len(missing.rows))
        answer: set[str] = context.window_manager.invoke_confirm(
            self, event, title=rpt_("Restore Deleted"), message=words
        )
        return answer

    def execute(self, context: Any) -> set[str]:
        """Brings them back; says how many."""
        missing = self._missing(context)
        if missing is None:
            return {"CANCELLED"}
        edited = context.mode == "EDIT_MESH"
        if edited:
            bpy.ops.object.mode_set(mode="OBJECT")
        restore(context.object, missing)
        if edited:
            bpy.ops.object.mode_set(mode="EDIT")
        self.report({"INFO"}, rpt_("{count:,} splats are back").format(count=len(missing.rows)))
        return {"FINISHED"}

    def _missing(self, context: Any) -> Missing | None:
        """What can be brought back; None, and said, where nothing can."""
        try:
            missing = missing_splats(context.object)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return None
        if not len(missing.rows):
            self.report({"INFO"}, rpt_("No splat of this twin was deleted"))
            return None
        return missing
