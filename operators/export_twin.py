"""Writes the active twin as a file of Gaussians."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.io_utils import ExportHelper

from ..core.errors import DgsError
from ..core.formats.gaussians import write_gaussians, written_formats
from ..dgs_addon.scene.twin import is_twin, read_twin


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
            write_gaussians(path, read_twin(context.object))
        except DgsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, _done(len(context.object.data.vertices), path))
        return {"FINISHED"}


def _done(count: int, path: Path) -> str:
    words: str = rpt_("{count:,} splats in {name}").format(count=count, name=path.name)
    return words
