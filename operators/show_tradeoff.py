"""Shows what accuracy costs, as `run_dgs.py tradeoff` drew it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.io_utils import ImportHelper

_NAME = "Descatter Tradeoff"


class DGS_OT_show_tradeoff(bpy.types.Operator, ImportHelper):
    """Show a measured chart of accuracy over time (tradeoff.png) in an image editor"""

    bl_idname = "dgs.show_tradeoff"
    bl_label = "Show Accuracy over Time"

    filename_ext = ".png"
    filter_glob: bpy.props.StringProperty(default="*.png", options={"HIDDEN"})

    def execute(self, context: Any) -> set[str]:
        """Loads the picture and, with a window, puts it into an editor."""
        path = Path(bpy.path.abspath(self.filepath))
        if path.is_dir():
            path = path / "tradeoff.png"
        if not path.is_file():
            words = rpt_("There is no chart '{path}': make one with run_dgs.py tradeoff").format(path=path)
            self.report({"ERROR"}, words)
            return {"CANCELLED"}
        image = bpy.data.images.load(str(path), check_existing=True)
        image.name = _NAME
        image.reload()
        if not image.size[0]:
            self.report({"ERROR"}, rpt_("'{path}' is no picture").format(path=path))
            bpy.data.images.remove(image)
            return {"CANCELLED"}
        if not bpy.app.background:
            _open(context, image)
        return {"FINISHED"}


def _open(context: Any, image: Any) -> None:
    """In an image editor that is open, else in a window of its own."""
    editors = [area for area in context.screen.areas if area.type == "IMAGE_EDITOR"]
    if not editors:
        bpy.ops.wm.window_new()
        area = context.window_manager.windows[-1].screen.areas[0]
        area.type = "IMAGE_EDITOR"
        editors = [area]
    editors[0].spaces.active.image = image
