"""Writes the active twin as a file of Gaussians."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.io_utils import ExportHelper

from ..core.errors import DgsError, OutputError
from ..core.formats.gaussians import write_gaussians, written_formats
from ..core.twin.folder import PARTS
from ..dgs_addon.paths import absolute, chosen_photos
from ..dgs_addon.scene.twin import is_twin, read_twin

#: How deep a twin's own files lie in its folder, at most: history/000/cameras/images.txt.
_DEEP = 4


class DGS_OT_export_twin(bpy.types.Operator, ExportHelper):
    """Export the active twin as 3D Gaussian splats, in the axes of the file or photos it came from"""

    bl_idname = "dgs.export_twin"
    bl_label = "Export Twin"

    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{spec.suffixes[0]}" for spec in written_formats()), options={"HIDDEN"}
    )
    format: bpy.props.EnumProperty(
        name="Format", items=[(spec.suffixes[0], spec.name, spec.holds) for spec in written_formats()]
    )

    @property
    def filename_ext(self) -> str:
        """The ending that Blender's file browser gives to the name."""
        return str(self.format)

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active."""
        cls.poll_message_set("Select a twin first")
        return is_twin(context.object)

    def execute(self, context: Any) -> set[str]:
        """Writes the file, in the format of its ending."""
        path = Path(bpy.path.abspath(self.filepath))
        try:
            _check_place(path, context.scene.dgs)
            write_gaussians(path, read_twin(context.object))
        except DgsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, _done(len(context.object.data.vertices), path))
        return {"FINISHED"}


def _check_place(path: Path, settings: Any) -> None:
    """Refuses what no export may replace, even where the file browser asked: photos, and parts of a twin's folder.

    Raises:
        OutputError: one of these.
    """
    place, found = path.resolve(), chosen_photos(settings)
    photos = () if found is None else (*found.files, *([found.movie] if found.movie else []))
    inputs = {file.resolve() for file in photos} | {absolute(settings.psf_file), absolute(settings.model)}
    if place in inputs:
        raise OutputError(f"'{path.name}' is a photo or another input of this scene", "Choose another name")
    parts = {part.name for part in PARTS}
    for folder in place.parents[:_DEEP]:
        if (folder / "report.json").is_file() and place.relative_to(folder).parts[0] in parts:
            raise OutputError(
                f"'{path.name}' would stand in the twin's own folder '{folder.name}', in the place of a part of it",
                "Choose another name or folder",
            )


def _done(count: int, path: Path) -> str:
    words: str = rpt_("{count:,} splats in {name}").format(count=count, name=path.name)
    return words
