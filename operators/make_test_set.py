"""Renders photos with a known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..dgs_addon.job import runner
from ..dgs_addon.job.test_set import test_set_request
from ..dgs_addon.paths import absolute
from .start_job import Replacing, start_job


class DGS_OT_make_test_set(Replacing, bpy.types.Operator):
    """Render photos of a known object with Cycles, blurred by the medium of step 3, and sharp ones to compare with"""

    bl_idname = "dgs.make_test_set"
    bl_label = "Make Test Set"
    kind = "synthesize"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a folder for it, and no job runs."""
        if runner.running():
            reason = "A job is running: wait for it or cancel it"
        elif not context.scene.dgs.test_set.strip():
            reason = "Choose a folder for the test set first"
        else:
            reason = ""
        cls.poll_message_set(reason)
        return not reason

    def folder(self, context: Any) -> Path | None:
        """The test set's own."""
        return absolute(context.scene.dgs.test_set)

    def execute(self, context: Any) -> set[str]:
        """Starts another Blender, which renders; the set becomes the photos of step 1 when it is there."""
        return start_job(self, context, lambda: test_set_request(context.scene.dgs), needs_engine=False)
