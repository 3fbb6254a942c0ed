"""Goes on with a job that ended before its time."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import runner
from ..dgs_addon.job.request import Request, resumed_request
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
        elif out is None:
            reason = "There is no unfinished job"
        else:
            record, fault = runner.unfinished(out)
            reason = in_users_language(fault) or ("There is no unfinished job" if record is None else why_not())
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine with what the job's record holds; it writes to the scene's results' folder."""

        def make() -> Request:
            out = out_folder(context.scene.dgs)
            record = runner.resumable(out) if out is not None else None
            if out is None or record is None:
                raise DgsError("There is no unfinished job", "Press Optimize (step 4)")
            return resumed_request(record, out)

        return start_job(self, context, make)
