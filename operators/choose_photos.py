"""Chooses the folder of photos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..dgs_addon.photos import forget, photo_folder


class DGS_OT_choose_photos(bpy.types.Operator):
    """Choose the folder with the photos"""

    bl_idname = "dgs.choose_photos"
    bl_label = "Choose Photos"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Opens the file browser; dropped photos bring their folder along."""
        if self.directory:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[str]:
        """Remembers the folder and says what is in it."""
        folder = Path(bpy.path.abspath(self.directory))
        if not self.directory or not folder.is_dir():
            self.report({"ERROR"}, f"There is no folder '{folder}'. Choose a folder of photos.")
            return {"CANCELLED"}
        forget()
        found = photo_folder(folder)
        if not found.files:
            self.report({"ERROR"}, f"'{folder.name}': {found.problem}.")
            return {"CANCELLED"}
        context.scene.dgs.photos = str(folder)
        if found.problem:
            self.report({"WARNING"}, found.problem)
        else:
            self.report({"INFO"}, f"{len(found.files)} photos")
        return {"FINISHED"}
