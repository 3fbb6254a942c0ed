"""Shows what the engine said."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..dgs_addon.job import runner
from ..dgs_addon.job.record import LOG
from ..dgs_addon.paths import out_folder

_NAME = "Descatter Log"
#: Bytes that are shown: the end of a long log.
_SHOWN = 200_000
#: Characters of a line: Blender takes seconds for one of all of them.
_LINE = 2_000


class DGS_OT_show_log(bpy.types.Operator):
    """Show the engine's output in a text editor"""

    bl_idname = "dgs.show_log"
    bl_label = "Show Log"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a log."""
        log = _log(context)
        cls.poll_message_set("No job has run yet")
        return log is not None and log.is_file()

    def execute(self, context: Any) -> set[str]:
        """Puts the log into a text block and, with a window, into an editor."""
        log = _log(context)
        assert log is not None
        try:
            with log.open("rb") as file:
                file.seek(max(0, log.stat().st_size - _SHOWN))
                words = file.read(_SHOWN).decode("utf-8", "replace").replace("\0", "\ufffd")
        except OSError as error:
            words = rpt_("'{path}' cannot be read ({reason}).").format(path=log, reason=error.strerror)
            self.report({"ERROR"}, words)
            return {"CANCELLED"}
        text = bpy.data.texts.get(_NAME) or bpy.data.texts.new(_NAME)
        text.clear()
        text.write(re.sub(f"([^\n]{{{_LINE}}})(?=[^\n])", r"\1\n", words))
        if not bpy.app.background:
            _open(context, text)
        return {"FINISHED"}


def _log(context: Any) -> Path | None:
    job, out = runner.current(), out_folder(context.scene.dgs)
    if job is not None and job.request.twin is not None and runner.belongs(job, context.scene):
        return job.log  # an update's or a comparison's own
    return None if out is None else out / LOG


def _open(context: Any, text: Any) -> None:
    """In a text editor that is open, else in a window of its own."""
    editors = [area for area in context.screen.areas if area.type == "TEXT_EDITOR"]
    if not editors:
        bpy.ops.wm.window_new()
        area = context.window_manager.windows[-1].screen.areas[0]
        area.type = "TEXT_EDITOR"
        editors = [area]
    editors[0].spaces.active.text = text
    editors[0].spaces.active.top = max(0, len(text.lines) - 30)
