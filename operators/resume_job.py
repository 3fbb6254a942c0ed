"""Goes on with a job that ended before its time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.job import runner
from ..dgs_addon.job.request import Kind, Request
from ..dgs_addon.paths import out_folder
from .start_job import start_job


class DGS_OT_resume_job(bpy.types.Operator):
    """Go on where the last job stopped, with its settings; at most the last 30 seconds are done again"""

    bl_idname = "dgs.resume_job"
    bl_label = "Resume"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The results' folder holds an unfinished job."""
        out = out_folder(context.scene.dgs)
        if runner.running():
            reason = "A job is running"
        elif out is None or runner.resumable(out) is None:
            reason = "There is no unfinished job"
        else:
            reason = why_not()
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine as it was started before."""
        out = out_folder(context.scene.dgs)
        assert out is not None
        record = runner.resumable(out)
        assert record is not None
        kind: Kind = "cameras" if record.kind == "cameras" else "reconstruct"
        # Cameras alone have no checkpoint: they are sought again.
        request = Request(
            kind,
            Path(record.photos),
            out,
            record.arguments,
            record.count,
            record.selection,
            resume=kind == "reconstruct",
        )
        return start_job(self, context, lambda: request)
