"""Puts the cameras that were found into the scene."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job.results import add_cameras_of
from ..dgs_addon.paths import out_folder, pictures_folder
from ..dgs_addon.scene.changes import noting


class DGS_OT_show_cameras(bpy.types.Operator):
    """Put the cameras of the last run into the scene, with the photos behind them"""

    bl_idname = "dgs.show_cameras"
    bl_label = "Add Cameras to Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Cameras are there."""
        out = out_folder(context.scene.dgs)
        cls.poll_message_set("No cameras yet: press Find Cameras, or Optimize (step 4)")
        return out is not None and (out / "cameras").is_dir()

    def execute(self, context: Any) -> set[str]:
        """Reads the model and looks through its first camera."""
        settings = context.scene.dgs
        out = out_folder(settings)
        assert out is not None
        try:
            with noting(context.scene):
                cameras = add_cameras_of(out, pictures_folder(settings), context.scene)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("{count} cameras").format(count=len(cameras)))
        return {"FINISHED"}
