"""Lets the job wait."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.job import runner


class DGS_OT_pause_job(bpy.types.Operator):
    """Let the job wait, so that the machine is free; or let it go on"""

    bl_idname = "dgs.pause_job"
    bl_label = "Pause"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """A job runs and was not asked to stop."""
        job = runner.current()
        cls.poll_message_set("No job is running, or it is stopping already")
        return job is not None and job.state.phase in ("running", "paused")

    def execute(self, _context: Any) -> set[str]:
        """Pauses, or ends the pause."""
        job = runner.current()
        assert job is not None
        runner.pause(job.state.phase == "running")
        return {"FINISHED"}
