"""Takes over what the engine found in the photos."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.questions import inspection


class DGS_OT_use_inspection(bpy.types.Operator):
    """Set medium and other effects to what the photos show"""

    bl_idname = "dgs.use_inspection"
    bl_label = "Use This"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """These photos were inspected."""
        cls.poll_message_set("Press Inspect Photos first")
        found = inspection.effects
        return bool(found.answer) and found.subject == (context.scene.dgs.photos,)

    def execute(self, context: Any) -> set[str]:
        """Changes the settings of step 3."""
        inspection.use(inspection.effects.answer, context.scene.dgs)
        return {"FINISHED"}
