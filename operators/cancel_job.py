"""Stops the job."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.job import runner


class DGS_OT_cancel_job(bpy.types.Operator):
    """Stop the job and keep what was done; pressed once more, it stops at once"""

    bl_idname = "dgs.cancel_job"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """A job runs."""
        cls.poll_message_set("No job is running")
        return runner.running()

    def execute(self, _context: Any) -> set[str]:
        """Asks the engine to stop."""
        runner.cancel()
        return {"FINISHED"}
