"""Makes the twin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ..dgs_addon.job.request import Request, request_of
from ..dgs_addon.job.steps import cameras_found
from .start_job import Replacing, start_job, why_no_job


class DGS_OT_optimize(Replacing, bpy.types.Operator):
    """Fit sharp Gaussians that explain the photos, seen through the medium. Finds the cameras first if need be"""

    bl_idname = "dgs.optimize"
    bl_label = "Optimize"
    kind = "reconstruct"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are photos and an engine, and no job runs."""
        reason = why_no_job(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; it runs beside Blender."""

        def make() -> Request:
            request = request_of("reconstruct", context.scene)
            return replace(request, reuse_cameras=cameras_found(context.scene))

        return start_job(self, context, make)
