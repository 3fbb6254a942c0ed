"""Puts a finished twin into the scene."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import runner
from ..dgs_addon.job.results import add_twin_of
from ..dgs_addon.paths import absolute, out_folder


class DGS_OT_add_results(bpy.types.Operator):
    """Put the twin and its cameras into this scene, and set it up for rendering"""

    bl_idname = "dgs.add_results"
    bl_label = "Add Twin to Scene"
    bl_options = {"REGISTER", "UNDO"}

    folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Results",
        subtype="DIR_PATH",
        options={"HIDDEN", "SKIP_SAVE"},
        description="Folder of another twin than that of this scene's photos",
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The results' folder holds a twin that is not being written; or there is one that found no scene."""
        out, job = out_folder(context.scene.dgs), runner.current()
        if job is not None and job.homeless:
            reason = ""
        elif out is None:
            reason = "Choose the folder of photos first (step 1)"
        elif runner.running():
            reason = "Wait for the job to end"
        elif not (out / "twin.ply").is_file():
            reason = "There is no twin yet: press Optimize (step 4)"
        else:
            reason = ""
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Reads the files; what came from the same folder before is replaced."""
        out = absolute(self.folder) or out_folder(context.scene.dgs)
        if out is None:
            self.report({"ERROR"}, rpt_("Choose the folder of photos first (step 1)"))
            return {"CANCELLED"}
        try:
            twin = add_twin_of(out, context.scene)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        runner.settle(out)
        self.report({"INFO"}, rpt_("{count:,} splats").format(count=len(twin.data.vertices)))
        return {"FINISHED"}
