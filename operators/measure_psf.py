"""Measures the medium's point spread from a photo of a point of light or of a slanted edge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ..core.errors import DgsError
from ..core.photos.kinds import HEIF, SUFFIXES
from ..dgs_addon.engine.interpreter import find_python, why_not
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.paths import out_folder
from ..dgs_addon.questions import inspection
from ..dgs_addon.window import redraw
from .wait_for_engine import answered


class DGS_OT_measure_psf(bpy.types.Operator, ImportHelper):
    """Choose a photo, taken through the medium, of a point of light in the dark or of a slightly slanted edge"""

    bl_idname = "dgs.measure_psf"
    bl_label = "Measure PSF from Photo"

    replace: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Replace",
        options={"HIDDEN", "SKIP_SAVE"},
        description="Replace files that this add-on did not write, or that were changed since",
    )

    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in sorted(SUFFIXES | HEIF)), options={"HIDDEN"}
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is an engine, and it is not measuring."""
        reason = "A photo is being measured already" if inspection.point_spread.running else why_not()
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; its kernel becomes the medium."""
        settings, photo = context.scene.dgs, Path(bpy.path.abspath(self.filepath))
        # Beside the results; without any, beside the photo.
        folder = out_folder(settings) or photo.parent
        kernel = folder / f"{photo.stem}_kernel.tif"
        try:
            command = inspection.measure_command(
                find_python(), photo, kernel, settings.blur_space == "linear", self.replace
            )
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        inspection.point_spread.ask((str(photo),), "Measuring the point spread", command)
        asking = context.scene.session_uid

        def use() -> None:
            scene = next((scene for scene in bpy.data.scenes if scene.session_uid == asking), None)
            if inspection.point_spread.answer and scene is not None:
                scene.dgs.medium, scene.dgs.psf_file = "file", str(kernel)
            redraw()

        return answered(self, inspection.point_spread, use)
