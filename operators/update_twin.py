"""New photos into the twin, the state before back, and all states along the timeline."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..core.lock import working_on
from ..core.twin.folder import TwinFolder
from ..dgs_addon.engine.interpreter import why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import runner
from ..dgs_addon.job.request import update_request
from ..dgs_addon.job.results import add_twin_of, twin_of
from ..dgs_addon.job.watching import Watch, twins_photos
from ..dgs_addon.paths import absolute, out_folder
from ..dgs_addon.scene.states import add_states
from .start_job import start_job


def _why_no_twin(scene: Any) -> str:
    out = out_folder(scene.dgs)
    if runner.busy():
        return "A job is running: wait for it or cancel it"
    if out is None or not (out / "twin.ply").is_file():
        return "There is no twin yet: press Optimize (step 4)"
    return ""


def _why_no_state(scene: Any) -> str:
    reason, out = _why_no_twin(scene), out_folder(scene.dgs)
    if not reason and out is not None and not TwinFolder(out).own_states():
        reason = "The twin has not been updated"
    return reason


def _why_no_earlier(scene: Any) -> str:
    """As `_why_no_state`; the twin of another run that stood in the folder before comes back, too."""
    out = out_folder(scene.dgs)
    if not runner.busy() and out is not None and TwinFolder(out).states():
        return ""
    return _why_no_state(scene) or "The twin has not been updated"


class DGS_OT_update_twin(bpy.types.Operator):
    """Take new photos of the same object into the twin; what it was before is kept"""

    bl_idname = "dgs.update_twin"
    bl_label = "Update Twin"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There are a twin and a folder of new photos."""
        folder = absolute(context.scene.dgs.new_photos)
        reason = _why_no_twin(context.scene) or why_not()
        if reason:
            pass
        elif folder is None:
            reason = "Choose the folder of new photos first"
        elif not folder.is_dir():
            reason = "The folder of new photos is not there"
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine with the photos that the twin was not made from."""

        def make() -> Any:
            settings = context.scene.dgs
            folder, out = absolute(settings.new_photos), out_folder(settings)
            assert folder is not None and out is not None
            photos = Watch(folder, twins_photos(out, absolute(settings.photos))).new()
            if not photos:
                raise DgsError(f"'{folder.name}' holds no new photos", "Names that the twin has already are left out")
            return update_request(settings, photos)

        return start_job(self, context, make)


class DGS_OT_rollback_twin(bpy.types.Operator):
    """Bring the twin back to what it was before the last update, or the twin that stood here before the last run"""

    bl_idname = "dgs.rollback_twin"
    bl_label = "Undo Update"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is an earlier state."""
        reason = _why_no_earlier(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Files first, then what the scene shows of them."""
        out = out_folder(context.scene.dgs)
        assert out is not None
        try:
            with working_on(out, "Undo Update", lambda done: self.report({"INFO"}, done)):
                TwinFolder(out).rollback()
            if twin_of(out, context.scene) is not None:
                add_twin_of(out, context.scene)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        return {"FINISHED"}


class DGS_OT_show_states(bpy.types.Operator):
    """Put every state of the twin on the timeline: play it to see how the twin grew"""

    bl_idname = "dgs.show_states"
    bl_label = "States on Timeline"
    bl_options = {"REGISTER", "UNDO"}

    frames: bpy.props.IntProperty(name="Frames", min=1, soft_max=250, default=24, description="Length of each state")

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The twin has an earlier state."""
        reason = _why_no_state(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Adds them; the twin itself is hidden, the last state is the same."""
        out = out_folder(context.scene.dgs)
        assert out is not None
        try:
            things = add_states(out, context.scene, frames=self.frames)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        twin = twin_of(out, context.scene)
        if twin is not None:
            for thing in things:  # where the twin stands, of its size
                thing.matrix_world = twin.matrix_world
            twin.hide_viewport = twin.hide_render = True
        self.report({"INFO"}, rpt_("{count} states").format(count=len(things)))
        return {"FINISHED"}
