"""Puts a file of Gaussians into the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.io_utils import ImportHelper

from ..core.errors import DgsError
from ..core.formats.gaussians import SPLAT_FORMATS, read_gaussians, read_suffixes
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.scene.changes import noting
from ..dgs_addon.scene.setting_up import set_up_scene
from ..dgs_addon.scene.sources import remember_source
from ..dgs_addon.scene.twin import add_twin


class DGS_OT_import_twin(bpy.types.Operator, ImportHelper):
    """Import 3D Gaussian splats from a file"""

    bl_idname = "dgs.import_twin"
    bl_label = "Import Twin"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = SPLAT_FORMATS[0].suffixes[0]
    # Not remembered: a path means that a file was dropped, or named by a script.
    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in read_suffixes()), options={"HIDDEN"}
    )  # type: ignore[valid-type]
    prepare: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Set Up Rendering",
        description="Choose a render engine that shows splats right, unless you have, and colours as in the photos",
        default=True,
    )

    @classmethod
    def description(cls, _context: Any, _properties: Any) -> str:
        """The tooltip names the formats."""
        formats = ", ".join(spec.name for spec in SPLAT_FORMATS)
        words: str = rpt_("Import 3D Gaussian splats from a file ({formats})").format(formats=formats)
        return words

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Asks for the file, unless one was dropped."""
        if self.properties.is_property_set("filepath"):
            return self.execute(context)
        return super().invoke(context, event)

    def execute(self, context: Any) -> set[str]:
        """Reads the file and selects the new object."""
        path = Path(bpy.path.abspath(self.filepath))
        try:
            cloud = read_gaussians(path)
            twin = add_twin(cloud, path.stem, context.collection)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        remember_source(twin.data, path, cloud)
        if self.prepare:
            with noting(context.scene):
                set_up_scene(context.scene)
        for other in context.selected_objects:
            other.select_set(False)
        twin.select_set(True)
        context.view_layer.objects.active = twin
        words = rpt_("{count:,} splats from {name}").format(count=len(twin.data.vertices), name=path.name)
        self.report({"INFO"}, words)
        return {"FINISHED"}
