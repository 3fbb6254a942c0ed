"""Takes a notice off the tab."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.job import runner
from ..dgs_addon.scene.changes import forget


class DGS_OT_dismiss(bpy.types.Operator):
    """Take this notice off the tab; nothing else changes"""

    bl_idname = "dgs.dismiss"
    bl_label = "Dismiss"
    bl_options = {"REGISTER", "UNDO"}

    notice: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Notice",
        options={"HIDDEN", "SKIP_SAVE"},
        items=(
            ("TWIN", "Twin", "A finished twin whose scene is gone"),
            ("CHANGES", "Changes", "What was changed of the scene for a twin; it stays so"),
        ),
    )

    def execute(self, context: Any) -> set[str]:
        """Forgets it; the twin stays in its folder, and the scene as it is."""
        if self.notice == "CHANGES":
            forget(context.scene)
            return {"FINISHED"}
        job = runner.current()
        if job is not None:
            runner.settle(job.request.home)
        return {"FINISHED"}
