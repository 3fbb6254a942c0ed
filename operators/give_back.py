"""Gives back what was changed of the scene for a twin."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.changes import changed_words, give_back, hidden_things


class DGS_OT_give_back(bpy.types.Operator):
    """Set the scene's own settings back to what they were before the twin came, and show what was hidden"""

    bl_idname = "dgs.give_back"
    bl_label = "Give Back"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Something was changed."""
        cls.poll_message_set("Nothing of this scene was changed")
        return bool(changed_words(context.scene) or hidden_things(context.scene))

    def execute(self, context: Any) -> set[str]:
        """Settings that somebody has changed since stay as they are."""
        give_back(context.scene)
        return {"FINISHED"}
