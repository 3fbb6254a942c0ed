"""The panel that holds the six steps: what runs now, and what hinders."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.job import runner
from ..dgs_addon.scene.changes import changed_words, hidden_things
from .job import draw_job
from .layout import Sidebar, sentence

#: Names of hidden objects that are shown.
_NAMES = 6


class DGS_PT_main(Sidebar, bpy.types.Panel):
    """From photos to a twin, in six steps."""

    bl_idname = "DGS_PT_main"
    bl_label = "Descatter"

    def draw_header_preset(self, context: Any) -> None:
        """The way to the manual."""
        self.layout.operator("dgs.open_manual", text="", icon="HELP", emboss=False)

    def draw(self, context: Any) -> None:
        """The job, or the missing engine with the button that brings it; else nothing: the steps speak."""
        missing = why_not()
        if missing and not runner.running():
            box = self.layout.box()
            sentence(box, context, missing, "ERROR")
            box.operator("dgs.open_preferences", icon="PREFERENCES")
        draw_job(self.layout, context)
        _draw_changes(self.layout, context)


def _draw_changes(layout: Any, context: Any) -> None:
    """What was changed of the scene for a twin, and the way back."""
    words, hidden = changed_words(context.scene), hidden_things(context.scene)
    if not words and not hidden:
        return
    box = layout.box()
    if words:
        listed = ", ".join(iface_(word) for word in words)
        sentence(box, context, "Changed for the twin: {words}", "INFO", words=listed)
    if hidden:
        names = ", ".join(thing.name for thing in hidden[:_NAMES])
        sentence(box, context, "Hidden: {names}", "HIDE_ON", names=names)
    row = box.row(align=True)
    row.operator("dgs.give_back", icon="LOOP_BACK")
    row.operator("dgs.dismiss", text="Keep", icon="CHECKMARK").notice = "CHANGES"
