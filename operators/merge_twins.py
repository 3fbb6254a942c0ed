"""Makes one twin of several, and transforms part of splats."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job.results import FOLDER
from ..dgs_addon.scene.merging import apply_transform, merge
from ..dgs_addon.scene.removal import take_out
from ..dgs_addon.scene.twin import is_twin


class DGS_OT_merge_twins(bpy.types.Operator):
    """Take the other selected twins into the active one as they stand. What they do not show is hidden"""

    bl_idname = "dgs.merge_twins"
    bl_label = "Merge Twins"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Two twins are selected, one of them active."""
        cls.poll_message_set("Select two twins or more in Object Mode")
        return context.mode == "OBJECT" and is_twin(context.object) and bool(_others(context))

    def execute(self, context: Any) -> set[str]:
        """Merges; the result belongs to no folder of results any more, so that no update takes its place."""
        target, others = context.object, _others(context)
        try:
            merge(target, others)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        target.pop(FOLDER, None)
        for other in others:
            for collection in list(other.users_collection):
                last = len(other.users_collection) == 1
                take_out(other, collection)
                if last:
                    break
        words = rpt_("One twin of {twins} with {count:,} splats")
        self.report({"INFO"}, words.format(twins=len(others) + 1, count=len(target.data.vertices)))
        return {"FINISHED"}


class DGS_OT_apply_transform(bpy.types.Operator):
    """Make place, turn and size of the selected twins part of their splats, gloss included. They look as before"""

    bl_idname = "dgs.apply_transform"
    bl_label = "Apply Twin's Transform"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active, in Object Mode."""
        cls.poll_message_set("Select a twin in Object Mode")
        return context.mode == "OBJECT" and is_twin(context.object)

    def execute(self, context: Any) -> set[str]:
        """Applies."""
        try:
            for twin in {context.object, *(thing for thing in context.selected_objects if is_twin(thing))}:
                apply_transform(twin)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        return {"FINISHED"}


def _others(context: Any) -> list[Any]:
    return [thing for thing in context.selected_objects if is_twin(thing) and thing != context.object]
