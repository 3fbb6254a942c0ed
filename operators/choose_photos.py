"""Chooses the photos: a folder, some files of one, a movie, or a data set of photos with their cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.photos.data_set import data_set, photos_in
from ..dgs_addon.data_sets import came_with_photos, cameras_among, take_cameras
from ..dgs_addon.photos import PhotoFolder, forget, is_movie, photo_folder, suffixes


class DGS_OT_choose_photos(bpy.types.Operator):
    """Choose the photos: a folder, several of its photos, or a movie. A single photo stands for its whole folder, \
a data set's folder brings its cameras"""

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
        cameras = cameras_among(folder, names)
        movie = next((name for name in names if is_movie(folder / name)), None)
        kinds = suffixes()
        chosen = [name for name in names if Path(name).suffix.lower() in kinds]
        place = folder if movie is None else folder / movie
        selection = "\n".join(sorted(chosen)) if movie is None and len(chosen) > 1 else ""
        forget()
        found = photo_folder(photos_in(place), selection)
        if not found.files and found.problem:
            self.report({"ERROR"}, f"'{place.name}': {found.problem}.")
            return {"CANCELLED"}
        settings = context.scene.dgs
        settings.photos = str(place)  # forgets the earlier selection, takes a data set's cameras
        settings.selection = selection
        if cameras is not None and data_set(place) is None:  # photos and cameras in one folder
            take_cameras(settings, cameras)
        self._say(found, place, settings)
        return {"FINISHED"}

    def _say(self, found: PhotoFolder, place: Path, settings: Any) -> None:
        """What was found."""
        if found.problem:
            self.report({"WARNING"}, found.problem)
            return
        words = place.name if found.movie else rpt_("{count} photos").format(count=len(found.files))
        if came_with_photos(settings):
            photos, model = (Path(bpy.path.abspath(text)) for text in (settings.photos, settings.model))
            words = rpt_("{count} photos of '{photos}', with the cameras of '{cameras}'").format(
                count=len(found.files), photos=photos.name, cameras=_name(model, place)
            )
        self.report({"INFO"}, words)


def _name(path: Path, root: Path) -> str:
    """A path as seen from a folder that it lies in."""
    return str(path.relative_to(root)) if path.is_relative_to(root) else path.name
