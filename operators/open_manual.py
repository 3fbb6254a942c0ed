"""Opens the manual."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.manual import FIRST, address


class DGS_OT_open_manual(bpy.types.Operator):
    """Open the manual, which came with the add-on, in the web browser; F1 on a button opens its place in it"""

    bl_idname = "dgs.open_manual"
    bl_label = "Manual"

    page: bpy.props.StringProperty(
        name="Page", default=FIRST, description="Page, and heading after a '#'", options={"SKIP_SAVE", "HIDDEN"}
    )

    def execute(self, context: Any) -> set[str]:
        """Hands the page to the system."""
        place = address(self.page)
        if bpy.app.background:
            self.report({"INFO"}, place)
            return {"FINISHED"}
        return bpy.ops.wm.url_open(url=place)
