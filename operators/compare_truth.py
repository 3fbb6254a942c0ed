"""Measures a finished twin against photos without the medium."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.job.request import Request, resumed_request
from ..dgs_addon.job.steps import results
from ..dgs_addon.paths import absolute, out_folder
from .start_job import start_job, why_no_job


class DGS_OT_compare_truth(bpy.types.Operator):
    """Measure the finished twin against the sharp photos: brightness, detail by size, and edges"""

    bl_idname = "dgs.compare_truth"
    bl_label = "Compare with Sharp Photos"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are a finished run and sharp photos, and no job runs."""
        settings, held = context.scene.dgs, results(context.scene)
        truth = absolute(settings.truth)
        reason = why_no_job(context.scene)
        if reason:
            pass
        elif held.record is None or held.record.kind != "reconstruct" or held.record.phase != "done":
            reason = "There is no finished run yet: press Optimize (step 4)"
        elif truth is None:
            reason = "Choose the folder of sharp photos first"
        elif not truth.is_dir():
            reason = "The folder of sharp photos is not there"
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """The engine takes up the finished run and scores it anew; nothing is optimized again."""

        def make() -> Request:
            settings = context.scene.dgs
            record, truth, out = results(context.scene).record, absolute(settings.truth), out_folder(settings)
            if record is None or truth is None or out is None:
                raise DgsError("There is no finished run", "Press Optimize (step 4)")
            return resumed_request(replace(record, options={**record.options, "truth": str(truth)}), out)

        return start_job(self, context, make)
