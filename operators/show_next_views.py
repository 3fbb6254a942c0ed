"""Puts the cameras to photograph from next into the scene."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.job.results import attach, twin_of
from ..dgs_addon.paths import out_folder
from ..dgs_addon.scene.next_views import add_next_views


class DGS_OT_show_next_views(bpy.types.Operator):
    """Put the cameras that next-view suggests into the scene, named by order and expected gain"""

    bl_idname = "dgs.show_next_views"
    bl_label = "Add Suggested Cameras"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Suggestions are there."""
        out = out_folder(context.scene.dgs)
        cls.poll_message_set("No suggestions yet: run next-view on the twin's folder")
        return out is not None and (out / "next_views.json").is_file()

    def execute(self, context: Any) -> set[str]:
        """Adds them, tied to the twin so that they move with it."""
        out = out_folder(context.scene.dgs)
        assert out is not None
        try:
            name = f"{out.name.removesuffix('-twin')} next views"
            cameras = add_next_views(out / "next_views.json", name, context.scene)
        except DgsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        twin = twin_of(out, context.scene)
        if twin is not None:
            attach(cameras, twin)
        self.report({"INFO"}, rpt_("{count} cameras").format(count=len(cameras)))
        return {"FINISHED"}
