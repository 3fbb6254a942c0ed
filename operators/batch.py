"""Makes a twin of each of several folders of photos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import find_python, why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import batch, runner


class DGS_OT_batch(bpy.types.Operator):
    """Choose a folder with a folder for each set of photos: each becomes a twin, with the settings of steps 3 and 4"""

    bl_idname = "dgs.batch"
    bl_label = "Several Folders"

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})  # type: ignore[valid-type]

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """There is an engine, and nothing runs."""
        busy = runner.running() or batch.running()
        reason = "A job is running: wait for it or cancel it" if busy else why_not()
        cls.poll_message_set(reason)
        return not reason

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Opens the file browser."""
        if self.directory:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        try:
            folders = batch.absolute_sets(self.directory)
            begun = batch.start(folders, context.scene.dgs, find_python())
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        if not bpy.app.background:
            self.report({"INFO"}, rpt_("{count} sets of photos").format(count=len(folders)))
            return {"FINISHED"}
        batch.wait()
        if begun.error:
            self.report({"ERROR"}, in_users_language(begun.error))
            return {"CANCELLED"}
        return {"FINISHED"}


class DGS_OT_cancel_batch(bpy.types.Operator):
    """Stop after what can be kept: finished twins stay, and the same button goes on from there. Again: stop at once"""

    bl_idname = "dgs.cancel_batch"
    bl_label = "Cancel Batch"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """One runs."""
        cls.poll_message_set("No batch is running")
        return batch.running()

    def execute(self, _context: Any) -> set[str]:
        """Asks the engine."""
        batch.cancel()
        return {"FINISHED"}


class DGS_OT_take_set(bpy.types.Operator):
    """Make this set the photos of step 1, and add its twin to the scene"""

    bl_idname = "dgs.take_set"
    bl_label = "Add Twin of Set"
    bl_options = {"REGISTER", "UNDO"}

    number: bpy.props.IntProperty(min=0, options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """A batch has made twins."""
        cls.poll_message_set("No batch has made twins yet")
        done = batch.current()
        return done is not None and bool(done.lines)

    def execute(self, context: Any) -> set[str]:
        """As after a job of its own."""
        done = batch.current()
        if done is None or self.number >= len(done.lines):
            return {"CANCELLED"}
        line = done.lines[self.number]
        context.scene.dgs.photos, context.scene.dgs.out = str(Path(line["photos"])), ""
        try:
            result: set[str] = bpy.ops.dgs.add_results(folder=line["out"])
        except RuntimeError as error:
            self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}
        return result
