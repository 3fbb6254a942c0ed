"""Asks the engine what a run would take."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import find_python
from ..dgs_addon.job import estimate
from ..dgs_addon.job.request import request_of
from ..dgs_addon.job.runner import redraw
from .start_job import why_no_job

_SCRIPT = Path(__file__).resolve().parent.parent / "run_dgs.py"


class DGS_OT_estimate(bpy.types.Operator):
    """Try a few iterations on these photos and tell how long a run would take, and what it would reach"""

    bl_idname = "dgs.estimate"
    bl_label = "Estimate"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are photos and an engine, and neither a job nor another estimate runs."""
        reason = "The engine is estimating already" if estimate.running() else why_no_job(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        try:
            arguments = request_of("reconstruct", context.scene).arguments
            words = estimate.command(find_python(), _SCRIPT, arguments)
        except DgsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        estimate.start(estimate.signature(context.scene.dgs), words)
        if not bpy.app.background:
            bpy.app.timers.register(_look, first_interval=0.2)
            return {"FINISHED"}
        while not estimate.take():
            time.sleep(0.05)
        _, error_text = estimate.known(context.scene.dgs)
        if error_text:
            self.report({"ERROR"}, error_text)
            return {"CANCELLED"}
        return {"FINISHED"}


def _look() -> float | None:
    if not estimate.take():
        return 0.2 if estimate.running() else None
    redraw()
    return None
