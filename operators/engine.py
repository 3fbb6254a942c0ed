"""Installs and checks the engine; cancels either."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError
from ..dgs_addon.engine import install
from ..dgs_addon.engine.folder import engine_folder
from ..dgs_addon.engine.interpreter import find_python, preferences
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.paths import absolute


class DGS_OT_install_engine(bpy.types.Operator):
    """Install the engine's packages into a Python environment of the add-on's own. Blender's Python stays as it is"""

    bl_idname = "dgs.install_engine"
    bl_label = "Install Engine"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """It is an extension, and there is a way to get the packages."""
        chosen = preferences()
        if engine_folder() is None or chosen is None:
            reason = "Only an installed extension has a folder for the engine"
        elif install.busy():
            reason = "An installation or a check is running"
        elif not bpy.app.online_access and not chosen.wheels.strip():
            reason = "Allow online access (Preferences > System), or choose a folder of wheels"
        else:
            reason = ""
        cls.poll_message_set(reason)
        return not reason

    def execute(self, _context: Any) -> set[str]:
        """Starts the installation; without a window it is waited for."""
        wheels = absolute(preferences().wheels)
        if wheels is not None and not wheels.is_dir():
            words = rpt_("There is no folder '{path}'. Choose the folder of wheels.")
            self.report({"ERROR"}, words.format(path=wheels))
            return {"CANCELLED"}
        return _wait(self, install.install_engine(wheels))


class DGS_OT_cancel_install(bpy.types.Operator):
    """Stop; pressing Install Engine again goes on from there"""

    bl_idname = "dgs.cancel_install"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """Something runs."""
        cls.poll_message_set("Nothing is running")
        return install.busy()

    def execute(self, _context: Any) -> set[str]:
        """Ends the command that runs."""
        work = install.errand()
        assert work is not None
        work.cancel()
        return {"FINISHED"}


class DGS_OT_check_engine(bpy.types.Operator):
    """Let the engine check itself: versions, device, and whether its parts agree with one another"""

    bl_idname = "dgs.check_engine"
    bl_label = "Check Engine"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """Nothing else runs."""
        cls.poll_message_set("An installation or a check is running")
        return not install.busy()

    def execute(self, _context: Any) -> set[str]:
        """Starts the engine's doctor; without a window it is waited for."""
        try:
            python = find_python()
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        return _wait(self, install.run([install.doctor_step(python)]))


class DGS_OT_open_preferences(bpy.types.Operator):
    """Open the add-on's preferences, where the engine is installed"""

    bl_idname = "dgs.open_preferences"
    bl_label = "Open Preferences"

    @classmethod
    def poll(cls, _context: Any) -> bool:
        """The add-on is enabled as one, and there is a window."""
        cls.poll_message_set("The add-on is not enabled in the preferences")
        return preferences() is not None and not bpy.app.background

    def execute(self, _context: Any) -> set[str]:
        """Shows the preferences at this add-on."""
        package = __package__.rsplit(".operators", 1)[0]
        return bpy.ops.preferences.addon_show(module=package)


def _wait(operator: Any, work: Any) -> set[str]:
    if not bpy.app.background:
        return {"FINISHED"}
    work.join(3600.0)
    for line in work.lines:
        print(line)
    if work.status != 0:
        last = in_users_language(work.lines[-1]) if work.lines else rpt_("no output")
        operator.report({"ERROR"}, rpt_("{step} failed: {words}").format(step=rpt_(work.title), words=last))
        return {"CANCELLED"}
    return {"FINISHED"}
