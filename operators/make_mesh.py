"""Makes a mesh of a twin's surface, beside Blender."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..core.errors import DgsError, FormatError
from ..dgs_addon.engine.errand import Errand, ErrandStep
from ..dgs_addon.engine.interpreter import find_python
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions import meshes
from ..dgs_addon.questions.measures import folder_of, mesh_command, why_no_measure
from ..dgs_addon.scene.surface import add_surface
from ..dgs_addon.scene.twin import is_twin
from ..dgs_addon.window import redraw

#: Seconds between two looks whether it is done.
_TICK = 0.2
#: Texels each way.
_TEXTURES = (
    ("0", "Off", "Colours at the corners of the mesh"),
    ("1024", "1024 px", "1024 x 1024 px"),
    ("2048", "2048 px", "2048 x 2048 px"),
    ("4096", "4096 px", "4096 x 4096 px"),
)


class DGS_OT_make_mesh(bpy.types.Operator):
    """Make a mesh of the twin's surface, where the twin stands. Blender's own exporters write it as GLB or OBJ"""

    bl_idname = "dgs.make_mesh"
    bl_label = "Make Mesh"

    detail: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Detail (px)",
        min=0.2,
        max=20.0,
        default=1.0,
        description="Size of the smallest parts, in px of the photos on the surface; smaller is finer and takes longer",
    )
    faces: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Faces", min=0, default=200_000, description="At most so many; 0 for all that there are"
    )
    texture: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Texture",
        items=_TEXTURES,
        default="0",
        description="Paint a picture and lay out UVs: a mesh of few faces then shows as much as one of many",
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin with a folder is active, and no mesh is being made."""
        reason = "A mesh is being made already" if meshes.making() else why_no_measure(context.object)
        if not reason and context.mode != "OBJECT":
            reason = "Leave Edit Mode first"
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """Starts the engine; without a window it is waited for."""
        twin, scene = context.object, context.scene
        place = Path(tempfile.mkdtemp(prefix="descatter-mesh-", dir=bpy.app.tempdir or None)) / "surface.ply"
        size = int(self.texture)
        if size:
            place = place.with_suffix(".obj")  # (what Blender reads welded, with its UVs; a PLY holds no texture)
        try:
            command = mesh_command(find_python(), folder_of(twin), place, self.detail, self.faces, size)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        errand = meshes.begin(Errand([ErrandStep("Making the mesh", command)]), twin.name)
        if not bpy.app.background:
            bpy.app.timers.register(lambda: _tick(errand, twin, place, scene), first_interval=_TICK, persistent=True)
            redraw()
            return {"FINISHED"}
        while errand.running:
            time.sleep(0.05)
        _done(errand, twin, place, scene)
        if meshes.error:
            self.report({"ERROR"}, in_users_language(meshes.error))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("The mesh is in the scene"))
        return {"FINISHED"}


def _tick(errand: Errand, twin: Any, place: Path, scene: Any) -> float | None:
    if errand.running:
        return _TICK
    _done(errand, twin, place, scene)
    redraw()
    return None


def _done(errand: Errand, twin: Any, place: Path, scene: Any) -> None:
    """Puts the mesh into the scene; what went wrong is kept for the panel."""
    reason = ""
    try:
        if errand.status:
            lines = [line for line in errand.lines if not line.startswith("$")]
            raise FormatError(lines[-1] if lines else f"The engine ended with status {errand.status}")
        if is_twin(twin) and twin.name in scene.objects:
            add_surface(twin, place, scene)
    except (DgsError, ReferenceError) as error:  # (the twin may be gone)
        reason = str(error)
    finally:
        shutil.rmtree(place.parent, ignore_errors=True)
    meshes.ended(reason)
