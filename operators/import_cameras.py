"""Puts the cameras of a model into the scene, with the photos behind them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.io_utils import ImportHelper

from ..core.errors import DgsError
from ..core.formats.cameras import browsed_suffixes, camera_labels
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.scene.cameras import add_cameras
from ..dgs_addon.scene.changes import noting


class DGS_OT_import_cameras(bpy.types.Operator, ImportHelper):
    """Import the cameras of a file, with their photos"""

    bl_idname = "dgs.import_cameras"
    bl_label = "Import Cameras"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ""
    filter_glob: bpy.props.StringProperty(  # type: ignore[valid-type]
        default=";".join(f"*{suffix}" for suffix in browsed_suffixes()), options={"HIDDEN"}
    )
    photos: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Photos", description="Folder of the photos to show behind the cameras", subtype="DIR_PATH"
    )

    @classmethod
    def description(cls, _context: Any, _properties: Any) -> str:
        """The tooltip names the formats."""
        words: str = rpt_("Import the cameras of a file, with their photos ({formats})").format(formats=camera_labels())
        return words

    def execute(self, context: Any) -> set[str]:
        """Reads the model and looks through its first camera."""
        photos = Path(bpy.path.abspath(self.photos)) if self.photos else None
        try:
            with noting(context.scene):
                cameras = add_cameras(Path(bpy.path.abspath(self.filepath)), photos, context.scene)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("{count} cameras").format(count=len(cameras)))
        return {"FINISHED"}
