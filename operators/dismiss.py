"""Takes a notice off the tab."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.job import runner


class DGS_OT_dismiss(bpy.types.Operator):
    """Take this notice off the tab; nothing else changes"""

    bl_idname = "dgs.dismiss"
    bl_label = "Dismiss"

    notice: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Notice", options={"HIDDEN", "SKIP_SAVE"}, items=(("TWIN", "Twin", "A finished twin whose scene is gone"),)
    )

    def execute(self, _context: Any) -> set[str]:
        """Forgets it; the twin stays in its folder."""
        job = runner.current()
        if job is not None:
            runner.settle(job.request.home)
        return {"FINISHED"}
