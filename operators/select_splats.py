"""Selects splats in Edit Mode by what they are: size, opacity, colour, expected error; and those that float."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from numpy.typing import NDArray

from ..core.errors import DgsError, FormatError
from ..dgs_addon.drawing.seen import photos_that_see
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.scene.floaters import photos_of_splats, sizes_of_islands
from ..dgs_addon.scene.selection import Splats, read_splats, select
from ..dgs_addon.scene.twin import is_twin

#: What 'Select by Size' begins with: the share of splats that are smaller.
_LARGE = 0.98

_ACTION = bpy.props.EnumProperty(
    name="Action",
    items=[
        ("SET", "Set", "Select these splats and no others"),
        ("EXTEND", "Extend", "Add these splats to the selection"),
        ("SUBTRACT", "Subtract", "Take these splats out of the selection"),
    ],
)
_SIDE = bpy.props.EnumProperty(
    name="Side", items=[("ABOVE", "Above", "Those above the limit"), ("BELOW", "Below", "Those below the limit")]
)


def edited_twins(context: Any) -> list[Any]:
    """The twins in Edit Mode; enters it with the active twin where there is none. Points can be selected then."""
    if context.mode != "EDIT_MESH":
        bpy.ops.object.mode_set(mode="EDIT")
    if not context.tool_settings.mesh_select_mode[0]:
        bpy.ops.mesh.select_mode(type="VERT")
    return [thing for thing in context.objects_in_mode_unique_data if is_twin(thing)]


class _OfATwin:
    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active, in Object or Edit Mode."""
        cls.poll_message_set("Select a twin first")  # type: ignore[attr-defined]
        return is_twin(context.object) and context.mode in ("OBJECT", "EDIT_MESH")


class _Select(_OfATwin):
    """Selects what `found` says, in all twins that are edited."""

    bl_options = {"REGISTER", "UNDO"}
    action: Any

    def found(self, context: Any, twin: Any, splats: Splats) -> NDArray[np.bool_]:
        """[N] which splats; raises DgsError."""
        raise NotImplementedError

    def execute(self, context: Any) -> set[str]:
        """Selects, and says how many."""
        found = selected = count = 0
        try:
            for twin in edited_twins(context):
                splats = read_splats(twin)
                chosen = self.found(context, twin, splats) & ~splats.hidden
                found, count = found + int(chosen.sum()), count + len(splats)
                if self.action != "SET":
                    chosen = splats.selected | chosen if self.action == "EXTEND" else splats.selected & ~chosen
                selected += select(twin, chosen)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        words = rpt_("{found:,} of {count:,} splats found, {selected:,} selected")
        self.report({"INFO"}, words.format(found=found, count=count, selected=selected))  # type: ignore[attr-defined]
        return {"FINISHED"}


class DGS_OT_select_by_size(_Select, bpy.types.Operator):
    """Select splats that are larger, or smaller, than a size: the longest of their standard deviations"""

    bl_idname = "dgs.select_by_size"
    bl_label = "Select by Size"

    size: bpy.props.FloatProperty(name="Size", min=0.0, default=0.1, subtype="DISTANCE", precision=4)  # type: ignore[valid-type]
    side: _SIDE  # type: ignore[valid-type]
    action: _ACTION  # type: ignore[valid-type]

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Begins with the largest splats of this twin."""
        if not self.properties.is_property_set("size"):
            self.size = float(np.quantile(read_splats(context.object).sizes, _LARGE))
        return self.execute(context)

    def found(self, _context: Any, _twin: Any, splats: Splats) -> NDArray[np.bool_]:
        """By size."""
        return _beyond(splats.sizes, self.size, self.side)


class DGS_OT_select_by_opacity(_Select, bpy.types.Operator):
    """Select splats that are more, or less, opaque than a limit"""

    bl_idname = "dgs.select_by_opacity"
    bl_label = "Select by Opacity"

    opacity: bpy.props.FloatProperty(name="Opacity", min=0.0, max=1.0, default=0.1, subtype="FACTOR")  # type: ignore[valid-type]
    side: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Side",
        items=[("ABOVE", "Above", "Those above the limit"), ("BELOW", "Below", "Those below the limit")],
        default="BELOW",
    )
    action: _ACTION  # type: ignore[valid-type]

    def found(self, _context: Any, _twin: Any, splats: Splats) -> NDArray[np.bool_]:
        """By opacity."""
        return _beyond(splats.opacities, self.opacity, self.side)


class DGS_OT_select_by_colour(_Select, bpy.types.Operator):
    """Select splats of a colour, to begin with that of the splats that are selected. The colour's field has a picker"""

    bl_idname = "dgs.select_by_colour"
    bl_label = "Select by Colour"

    colour: bpy.props.FloatVectorProperty(  # type: ignore[valid-type]
        name="Colour", subtype="COLOR_GAMMA", min=0.0, max=1.0, default=(0.5, 0.5, 0.5)
    )
    tolerance: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Tolerance",
        description="Largest difference of red, green or blue",
        min=0.0,
        max=1.0,
        default=0.1,
        subtype="FACTOR",
    )
    action: _ACTION  # type: ignore[valid-type]

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Begins with the mean colour of what is selected."""
        if not self.properties.is_property_set("colour"):
            splats = read_splats(context.object)
            if splats.selected.any():
                self.colour = splats.colours[splats.selected].mean(axis=0).tolist()
        return self.execute(context)

    def found(self, _context: Any, _twin: Any, splats: Splats) -> NDArray[np.bool_]:
        """By colour without gloss."""
        away = np.abs(splats.colours - np.array(self.colour, np.float32)).max(axis=1)
        return away <= np.float32(self.tolerance)


class DGS_OT_select_by_error(_Select, bpy.types.Operator):
    """Select splats whose colour the photos leave open: 0 is a colour that they fix, 1 one that is a mere guess"""

    bl_idname = "dgs.select_by_error"
    bl_label = "Select by Expected Error"

    error: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Expected Error", min=0.0, max=1.0, default=0.7, subtype="FACTOR"
    )
    side: _SIDE  # type: ignore[valid-type]
    action: _ACTION  # type: ignore[valid-type]

    def found(self, _context: Any, twin: Any, splats: Splats) -> NDArray[np.bool_]:
        """By the error that is expected of the colour."""
        if splats.errors is None:
            raise FormatError(
                f"Nobody has estimated the errors of '{twin.name}' in its present state",
                "Press Suggest Next Views, which does",
            )
        return _beyond(splats.errors, self.error, self.side)


class DGS_OT_select_floaters(_Select, bpy.types.Operator):
    """Select splats that float: hardly a photo sees them, or they touch no large part of the twin"""

    bl_idname = "dgs.select_floaters"
    bl_label = "Select Floaters"

    photos: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Fewer Photos Than",
        description="Select splats that fewer photos than so many see; 0 for none. Needs the cameras",
        min=0,
        soft_max=20,
        default=2,
    )
    weighed: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="As the Engine Sees",
        description="A photo sees a splat of which it shows a px or so; the engine says which, in seconds. "
        "Else each counts that lies within the photo's frame",
        default=True,
    )
    island: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Islands Below",
        description="Select islands of fewer splats than so many; 0 for none",
        min=0,
        soft_max=10_000,
        default=100,
    )
    gap: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Gap",
        description="Splats touch where their centres are no farther apart than so many times their sizes",
        min=0.0,
        soft_max=5.0,
        default=1.5,
    )
    action: _ACTION  # type: ignore[valid-type]

    def found(self, context: Any, twin: Any, splats: Splats) -> NDArray[np.bool_]:
        """By the photos' frames and by islands."""
        shown = ~splats.hidden
        found = np.zeros(len(splats), bool)
        seen = self._seen(context, twin, splats) if self.photos else None
        if seen is not None:
            found |= seen < self.photos
        if self.island:
            sizes = sizes_of_islands(splats.places, splats.own_sizes, self.gap, shown & ~found)
            found |= sizes < self.island
        return found & shown

    def _seen(self, context: Any, twin: Any, splats: Splats) -> NDArray[np.intp] | None:
        """[N] how many photos see each splat; None without cameras."""
        frames = photos_of_splats(twin, splats.places, context.scene)
        if frames is None or not self.weighed:
            return frames
        manager = context.window_manager
        manager.progress_begin(0.0, 1.0)
        try:
            return photos_that_see(twin, context.scene, manager.progress_update)
        except DgsError as error:
            self.report({"WARNING"}, in_users_language(str(error)))
            return frames
        finally:
            manager.progress_end()


def _beyond(values: NDArray[np.float32], limit: float, side: str) -> NDArray[np.bool_]:
    return values > np.float32(limit) if side == "ABOVE" else values < np.float32(limit)
