"""Asks the engine which effects the photos show."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import find_python
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.paths import absolute, out_folder
from ..dgs_addon.questions import inspection
from ..dgs_addon.window import redraw
from .start_job import why_no_job
from .wait_for_engine import answered


class DGS_OT_inspect_photos(bpy.types.Operator):
    """Look for blur, defocus, motion, haze, uneven exposure, vignetting, noise and clipping in the photos"""

    bl_idname = "dgs.inspect_photos"
    bl_label = "Inspect Photos"

    replace: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Replace",
        options={"HIDDEN", "SKIP_SAVE"},
        description="Replace files that this add-on did not write, or that were changed since",
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are photos and an engine, and neither a job nor another inspection runs."""
        busy = inspection.effects.running
        reason = "The photos are being inspected already" if busy else why_no_job(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        settings = context.scene.dgs
        photos, out = absolute(settings.photos), out_folder(settings)
        if photos is None or out is None:
            self.report({"ERROR"}, in_users_language("No photos are chosen. Choose their folder in step 1."))
            return {"CANCELLED"}
        found = out / "cameras"
        cameras = found if found.is_dir() else None
        try:
            command = inspection.inspect_command(find_python(), photos, out / "inspection", cameras, self.replace)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        inspection.effects.ask((settings.photos,), "Inspecting the photos", command)
        return answered(self, inspection.effects, redraw)
