"""Writes the active twin as a 3DGS PLY."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper

from ..core.errors import DgsError
from ..dgs_addon.scene.twin import is_twin, read_twin


class DGS_OT_export_twin(bpy.types.Operator, ExportHelper):
    """Export the active twin as 3D Gaussian splats, in the axes of the file or photos it came from"""

    bl_idname = "dgs.export_twin"
    bl_label = "Export Twin"

    filename_ext = ".ply"
    filter_glob: bpy.props.StringProperty(default="*.ply", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active."""
        cls.poll_message_set("Select a twin first")
        return is_twin(context.object)

    def execute(self, context: Any) -> set[str]:
        """Writes the file."""
        from ..core.formats.ply import write_ply

        path = Path(bpy.path.abspath(self.filepath))
        try:
            write_ply(path, read_twin(context.object))
        except DgsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{len(context.object.data.vertices):,} splats in {path.name}")
        return {"FINISHED"}
