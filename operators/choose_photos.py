"""Chooses the photos: a folder, some files of one, or a movie."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..dgs_addon.photos import forget, is_movie, photo_folder, suffixes


class DGS_OT_choose_photos(bpy.types.Operator):
    """Choose the photos: a folder, several of its photos, or a movie. A single photo stands for its whole folder"""

    bl_idname = "dgs.choose_photos"
    bl_label = "Choose Photos"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_movie: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Opens the file browser; a drop has named them already."""
        if self.directory:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[str]:
        """Remembers what was chosen and says what is in it."""
        folder = Path(bpy.path.abspath(self.directory))
        if not self.directory or not folder.is_dir():
            self.report({"ERROR"}, rpt_("There is no folder '{path}'. Choose a folder of photos.").format(path=folder))
            return {"CANCELLED"}
        names = [file.name for file in self.files if file.name]
        movie = next((name for name in names if is_movie(folder / name)), None)
        kinds = suffixes()
        chosen = [name for name in names if Path(name).suffix.lower() in kinds]
        place = folder if movie is None else folder / movie
        selection = "\n".join(sorted(chosen)) if movie is None and len(chosen) > 1 else ""
        forget()
        found = photo_folder(place, selection)
        if not found.files and found.problem:
            self.report({"ERROR"}, f"'{place.name}': {found.problem}.")
            return {"CANCELLED"}
        settings = context.scene.dgs
        settings.photos = str(place)  # forgets the earlier selection
        settings.selection = selection
        if found.problem:
            self.report({"WARNING"}, found.problem)
        else:
            words = place.name if found.movie else rpt_("{count} photos").format(count=len(found.files))
            self.report({"INFO"}, words)
        return {"FINISHED"}
