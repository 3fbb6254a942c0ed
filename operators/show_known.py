"""Paints a twin by what its photos fix and what is guessed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job.results import FOLDER
from ..dgs_addon.scene.known import add_known, show_known
from ..dgs_addon.scene.twin import OWN_BASE, is_twin


class DGS_OT_show_known(bpy.types.Operator):
    """Paint the splats by how far the photos determine them: blue determined, red guessed. Again: their own colours"""

    bl_idname = "dgs.show_known"
    bl_label = "Determined and Guessed"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The active object is a twin from a folder with known.npy."""
        twin = context.object
        cls.poll_message_set("Select a twin, and press Suggest Next Views")
        if not is_twin(twin):
            return False
        return OWN_BASE in twin.data.attributes or (Path(str(twin.get(FOLDER, ""))) / "known.npy").is_file()

    def execute(self, context: Any) -> set[str]:
        """Switches."""
        twin = context.object
        if OWN_BASE in twin.data.attributes:
            show_known(twin, False)
            return {"FINISHED"}
        try:
            add_known(twin, Path(str(twin[FOLDER])) / "known.npy")
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        show_known(twin, True)
        return {"FINISHED"}
