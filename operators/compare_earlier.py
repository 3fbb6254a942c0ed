"""Compares a twin with an earlier one of the same object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..core.errors import FormatError
from ..dgs_addon.job import runner
from ..dgs_addon.job.request import Request, change_request
from ..dgs_addon.questions.measures import folder_of, why_no_measure
from .start_job import start_job


class DGS_OT_compare_earlier(bpy.types.Operator):
    """Find what has changed of the object since an earlier twin: choose the folder of that twin's results"""

    bl_idname = "dgs.compare_earlier"
    bl_label = "Compare with Earlier Twin"

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})  # type: ignore[valid-type]

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin with a folder is active, and no job runs."""
        reason = why_no_measure(context.object)
        if not reason and runner.busy():
            reason = "A job is running: wait for it or cancel it"
        elif not reason and context.mode != "OBJECT":
            reason = "Leave Edit Mode first"
        cls.poll_message_set(reason)
        return not reason

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Opens the file browser."""
        if self.directory:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; what it finds comes into the scene."""
        twin = context.object

        def make() -> Request:
            if not self.directory.strip():
                raise FormatError("No earlier twin is chosen", "Choose the folder of its results")
            earlier = Path(bpy.path.abspath(self.directory))
            return change_request(context.scene.dgs, twin, folder_of(twin), earlier)

        return start_job(self, context, make)
