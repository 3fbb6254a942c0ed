"""Asks the engine what a run would take."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import find_python
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job.request import request_of
from ..dgs_addon.questions import estimate
from ..dgs_addon.window import redraw
from .start_job import why_no_job
from .wait_for_engine import answered


class DGS_OT_estimate(bpy.types.Operator):
    """Predict how long a run would take and how accurate it would be, from a few steps on these photos"""

    bl_idname = "dgs.estimate"
    bl_label = "Estimate"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are photos and an engine, and neither a job nor another estimate runs."""
        reason = "The engine is estimating already" if estimate.question.running else why_no_job(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        try:
            arguments = request_of("reconstruct", context.scene).arguments
            command = estimate.estimate_command(find_python(), arguments)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        estimate.question.ask(estimate.signature(context.scene.dgs), "Estimating", command)
        return answered(self, estimate.question, redraw)
