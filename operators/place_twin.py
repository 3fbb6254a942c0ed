"""Gives a twin its true size and its up direction."""

from __future__ import annotations

import math
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.scene.placing import markers, set_length, set_up
from ..dgs_addon.scene.twin import scene_twin


class _OfATwin:
    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin."""
        cls.poll_message_set("There is no twin in this scene yet")  # type: ignore[attr-defined]
        return scene_twin(context.scene, context.object) is not None


class DGS_OT_set_length(_OfATwin, bpy.types.Operator):
    """Scale the twin: two selected objects on it, or else the way through its cameras, get the known length"""

    bl_idname = "dgs.set_length"
    bl_label = "Set Size"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Scales the twin and its cameras."""
        twin = scene_twin(context.scene, context.object)
        try:
            factor = set_length(twin, markers(twin, context.selected_objects), context.scene.dgs.known_length)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("Scaled by {factor:.4g}").format(factor=factor))
        return {"FINISHED"}


class DGS_OT_set_up(_OfATwin, bpy.types.Operator):
    """Turn the twin until three selected objects on its floor lie level, or else its cameras stand upright"""

    bl_idname = "dgs.set_up"
    bl_label = "Set Up Direction"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Turns the twin and its cameras."""
        twin = scene_twin(context.scene, context.object)
        try:
            angle = set_up(twin, markers(twin, context.selected_objects))
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("Turned by {angle:.1f} degrees").format(angle=math.degrees(angle)))
        return {"FINISHED"}
