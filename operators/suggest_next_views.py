"""Asks the engine from where to take the next photos."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import find_python, why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import runner
from ..dgs_addon.job.results import add_suggested
from ..dgs_addon.paths import out_folder
from ..dgs_addon.questions.next_views import next_views_command, question
from ..dgs_addon.window import redraw
from .wait_for_engine import answered


class DGS_OT_suggest_next_views(bpy.types.Operator):
    """Find the places from which further photos would add most to this twin, and put cameras there"""

    bl_idname = "dgs.suggest_next_views"
    bl_label = "Suggest Next Views"

    count: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Views", min=1, max=100, default=3, description="Cameras to suggest, in the order in which to take photos"
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are a finished twin and an engine, and neither a job nor another search runs."""
        out = out_folder(context.scene.dgs)
        if question.running:
            reason = "The engine is looking for views already"
        elif runner.running():
            reason = "A job is running: wait for it or cancel it"
        elif out is None or not (out / "twin.ply").is_file():
            reason = "There is no twin yet: press Optimize (step 4)"
        else:
            reason = why_not()
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        out, asking = out_folder(context.scene.dgs), context.scene.session_uid
        assert out is not None
        try:
            command = next_views_command(find_python(), out, self.count)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        question.ask((str(out),), "Looking for the next views", command)

        def show() -> None:
            scene = next((scene for scene in bpy.data.scenes if scene.session_uid == asking), None)
            try:
                if question.answer and scene is not None:  # else they wait for Add Suggested Cameras
                    add_suggested(out, scene)
            except DgsError as error:
                question.error = str(error)
            redraw()

        return answered(self, question, show)
