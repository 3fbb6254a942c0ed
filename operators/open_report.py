"""Opens the report of the last run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..dgs_addon.paths import out_folder


class DGS_OT_open_report(bpy.types.Operator):
    """Open the report in the web browser: photos, renders, scores and settings of the last run"""

    bl_idname = "dgs.open_report"
    bl_label = "Open Report"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The report is there."""
        report = _report(context)
        cls.poll_message_set("There is no report yet: press Optimize (step 4)")
        return report is not None and report.is_file()

    def execute(self, context: Any) -> set[str]:
        """Hands the page to the system."""
        report = _report(context)
        assert report is not None
        if bpy.app.background:
            self.report({"INFO"}, str(report))
            return {"FINISHED"}
        return bpy.ops.wm.url_open(url=report.as_uri())


def _report(context: Any) -> Path | None:
    out = out_folder(context.scene.dgs)
    return None if out is None else out / "report.html"
