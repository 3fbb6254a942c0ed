"""What the operators that start the engine have in common."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError, ForeignFiles
from ..dgs_addon.engine.interpreter import find_python, why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import batch, runner
from ..dgs_addon.job.foreign import foreign_files
from ..dgs_addon.job.request import Kind, Request
from ..dgs_addon.paths import chosen_photos, out_folder
from ..dgs_addon.window import wrapped

#: Width of the question whether to replace files, in px at a scale of 1.
_WIDTH = 420


class Replacing:
    """For operators whose results may stand in the place of somebody's files: they ask first.

    Attributes:
        kind: of the job.
        asked_folder: which folder the question was about: what is allowed there is allowed nowhere else.
    """

    kind: Kind
    replace: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Replace",
        options={"HIDDEN", "SKIP_SAVE"},
        description="Replace files in the results' folder that this add-on did not write",
    )
    asked_folder: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def folder(self, context: Any) -> Path | None:
        """Where the job writes."""
        return out_folder(context.scene.dgs)

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Asks where there is something to ask."""
        out = self.folder(context)
        if out is None or self.replace or not foreign_files(self.kind, out):
            return self.execute(context)
        self.replace, self.asked_folder = True, str(out)  # if the question is answered with yes
        answer: set[str] = context.window_manager.invoke_props_dialog(
            self,
            width=_WIDTH,
            title=iface_("Replace Files of Others?"),
            confirm_text=iface_("Replace"),
            cancel_default=True,
        )
        return answer

    def draw(self, context: Any) -> None:
        """What is there, and the way to leave it alone."""
        layout = self.layout  # type: ignore[attr-defined]
        out = self.folder(context)
        held = foreign_files(self.kind, out) if out is not None else ""
        column = layout.column(align=True)
        for line in wrapped(in_users_language(held) or iface_("This folder holds nothing of others"), _WIDTH):
            column.label(text=line, translate=False)
        layout.label(text="To leave them alone, choose another folder here:")
        layout.prop(context.scene.dgs, "test_set" if self.kind == "synthesize" else "out", text="")

    def allowed(self, context: Any) -> bool:
        """Whether files of others may be replaced.

        Raises:
            ForeignFiles: there are some, and nobody has allowed it.
        """
        out = self.folder(context)
        allowed = bool(self.replace) and self.asked_folder in ("", str(out))
        held = foreign_files(self.kind, out) if out is not None else ""
        if held and not allowed:
            raise ForeignFiles(held, "Choose another folder, or allow it with replace=True")
        return bool(held)

    def execute(self, context: Any) -> set[str]:
        """The operator's own."""
        raise NotImplementedError


def why_no_job(scene: Any) -> str:
    """Why no job can be started now; '' if one can."""
    if runner.running() or batch.running():
        return "A job is running: wait for it or cancel it"
    found = chosen_photos(scene.dgs)
    if found is None:
        return "Choose the folder of photos first (step 1)"
    return found.problem or why_not()


def start_job(operator: Any, context: Any, make: Callable[[], Request], needs_engine: bool = True) -> set[str]:
    """Starts what `make` asks for; without a window it is waited for."""
    try:
        overwrite = isinstance(operator, Replacing) and operator.allowed(context)  # before `make` writes anything
        request = replace(make(), overwrite=overwrite)
        job = runner.start(request, find_python() if needs_engine else Path(sys.executable), context.scene)
    except DgsError as error:
        operator.report({"ERROR"}, in_users_language(str(error)))
        return {"CANCELLED"}
    if not bpy.app.background:
        return {"FINISHED"}
    runner.wait()
    if job.state.phase != "done":
        operator.report({"ERROR"}, in_users_language(job.state.error) or rpt_("Cancelled; what was done is kept"))
        return {"CANCELLED"}
    return {"FINISHED"}
