"""The panel that holds the six steps: what runs now, and what hinders."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.job import runner
from .job import draw_job
from .layout import Sidebar, sentence


class DGS_PT_main(Sidebar, bpy.types.Panel):
    """From photos to a twin, in six steps."""

    bl_idname = "DGS_PT_main"
    bl_label = "Descatter"

    def draw(self, context: Any) -> None:
        """The job, or the missing engine with the button that brings it; else nothing: the steps speak."""
        missing = why_not()
        if missing and not runner.running():
            box = self.layout.box()
            sentence(box, context, missing, "ERROR")
            box.operator("dgs.open_preferences", icon="PREFERENCES")
        draw_job(self.layout, context)
