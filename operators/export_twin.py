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
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.paths import absolute, chosen_photos
from ..dgs_addon.scene.shown import is_limited, is_moved, placed, shown_part
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

    only_shown: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Only What Is Shown",
        description="Leave out what the crop box, the least opacity and the largest number hide, and write splats "
        "in the size that they are shown in",
    )
    placed: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="With Size and Up",
        description="Write the twin as large as it is in the scene, turned and placed as it stands there; "
        "its gloss turns along",
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
        path, twin = Path(bpy.path.abspath(self.filepath)), context.object
        try:
            check_place(path, context.scene.dgs)
            cloud = whole = read_twin(twin)
            if self.only_shown:
                cloud = shown_part(twin, cloud)
            if self.placed:
                cloud = placed(twin, cloud)
            write_gaussians(path, cloud)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, _done(len(cloud), path))
        if not self.only_shown and is_limited(twin, whole):
            self.report({"WARNING"}, rpt_("All splats were written: 'Only What Is Shown' leaves out what is hidden"))
        if not self.placed and is_moved(twin):
            words = rpt_("Written as it came from the photos: 'With Size and Up' writes it as it stands in the scene")
            self.report({"WARNING"}, words)
        return {"FINISHED"}


def check_place(path: Path, settings: Any) -> None:
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
