"""Finds the cameras of the photos."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.job.request import request_of
from .start_job import Replacing, start_job, why_no_job


class DGS_OT_find_cameras(Replacing, bpy.types.Operator):
    """Find out where each photo was taken (structure from motion). Optimize does this too, if need be"""

    bl_idname = "dgs.find_cameras"
    bl_label = "Find Cameras"
    kind = "cameras"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are photos and an engine, and no job runs."""
        reason = why_no_job(context.scene)
        if not reason and context.scene.dgs.cameras != "photos":
            reason = "The cameras are given: there is nothing to find"
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine."""
        return start_job(self, context, lambda: request_of("cameras", context.scene))
