"""Takes a twin out of the scene."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.job.results import remove_twin
from ..dgs_addon.scene.twin import is_twin


class DGS_OT_remove_twin(bpy.types.Operator):
    """Take the active twin out of the scene, with its cameras, points and crop box. Its files stay"""

    bl_idname = "dgs.remove_twin"
    bl_label = "Remove Twin"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active."""
        cls.poll_message_set("Select a twin first")
        return is_twin(context.object)

    def execute(self, context: Any) -> set[str]:
        """What others use, such as linked duplicates, stays."""
        remove_twin(context.object, context.scene)
        return {"FINISHED"}
