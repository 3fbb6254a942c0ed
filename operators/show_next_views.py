"""Puts the cameras to photograph from next into the scene."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job.results import add_suggested
from ..dgs_addon.paths import out_folder


class DGS_OT_show_next_views(bpy.types.Operator):
    """Put the cameras that were suggested last into the scene, named by order and expected gain"""

    bl_idname = "dgs.show_next_views"
    bl_label = "Add Suggested Cameras"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Suggestions are there."""
        out = out_folder(context.scene.dgs)
        cls.poll_message_set("No suggestions yet: press Suggest Next Views")
        return out is not None and (out / "next_views.json").is_file()

    def execute(self, context: Any) -> set[str]:
        """Adds them, tied to the twin so that they move with it."""
        out = out_folder(context.scene.dgs)
        assert out is not None
        try:
            cameras = add_suggested(out, context.scene)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("{count} cameras").format(count=len(cameras)))
        return {"FINISHED"}
