"""Step 5, folded: measures of the twin, its mesh, and what has changed of it."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..core.measure.rows import NO_SCALE
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions import measures, meshes
from ..dgs_addon.scene.comparison import changed_mesh, changes_of, line_of, shows_changes
from ..dgs_addon.scene.measures import KINDS, active_measure, board_of, known_measure, measures_of, value_text
from ..dgs_addon.scene.twin import is_twin
from .layout import Sidebar, figures, sentence

#: Rows of the list, at least and at most.
_ROWS = (3, 8)
#: Changes that are listed.
_CHANGES = 12


class DGS_UL_measures(bpy.types.UIList):
    """A measure: what it is called, and what came out."""

    bl_idname = "DGS_UL_measures"

    def draw_item(
        self, _context: Any, layout: Any, _data: Any, item: Any, _icon: Any, _owner: Any, _chosen: Any
    ) -> None:
        """One line."""
        row = layout.row(align=True)
        parts = row.split(factor=0.42, align=True)
        parts.prop(item, "name", text="", emboss=False, icon=KINDS[item.kind][2])
        right = parts.row(align=True)
        right.alert = not item.found
        value = right.row()
        value.alignment = "RIGHT"
        value.label(text=value_text(item), icon="LOCKED" if item.known else "NONE", translate=False)
        right.prop(item, "shown", text="", emboss=False, icon="HIDE_OFF" if item.shown else "HIDE_ON")


class DGS_PT_twin_measure(Sidebar, bpy.types.Panel):
    """Lengths, angles, widths, areas; the surface as a mesh."""

    bl_idname = "DGS_PT_twin_measure"
    bl_label = "Measure"
    bl_parent_id = "DGS_PT_twin"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Shown for twins only."""
        return is_twin(context.object)

    def draw(self, context: Any) -> None:
        """Tools, the list, what is chosen in it, and the mesh."""
        layout = self.layout
        twin = context.object
        _draw_tools(layout, context)
        held = measures_of(twin)
        if held is not None and held.items:
            _draw_list(layout, context, twin, held)
        column = layout.column()
        column.operator("dgs.make_mesh", icon="MESH_DATA")
        if meshes.making():
            column.label(text="Making the mesh...", icon="TIME")
        elif meshes.error and meshes.subject == twin.name:
            sentence(column, context, in_users_language(meshes.error), "ERROR")
        layout.operator("dgs.compare_earlier", icon="RECOVER_LAST")
        _draw_changes(layout, context, twin)


def _draw_changes(layout: Any, context: Any, twin: Any) -> None:
    """What has changed since an earlier twin: a line for each region, the largest first."""
    held = changes_of(twin)
    if held is None:
        return
    box = layout.box()
    row = box.row()
    figures(row, "Since {name}", "TIME", name=held["before"])
    if changed_mesh(twin) is not None:
        shown = shows_changes(twin)
        row.operator("dgs.show_changes", text="", icon="HIDE_OFF" if shown else "HIDE_ON", depress=shown)
    column = box.column(align=True)
    for region in held["regions"][:_CHANGES]:
        text, icon, values = line_of(region)
        sentence(column, context, text, icon, **values)
    more = len(held["regions"]) - _CHANGES
    if more > 0:
        sentence(column, context, "And {count} smaller ones: see change.csv", "BLANK1", count=more)
    if not held["regions"]:
        sentence(column, context, "Nothing has changed beyond chance", "CHECKMARK")
    sentence(column, context, "{held} of {places} places are shown by photos of both", "INFO", **_counts(held))
    if any(region["unit"] == NO_SCALE for region in held["regions"]):
        sentence(column, context, "No length is known: px are px-equivalents, px of the photos there", "INFO")


def _counts(held: dict[str, Any]) -> dict[str, int]:
    return {name: held[name] for name in ("held", "places")}


def _draw_tools(layout: Any, context: Any) -> None:
    """A button for each kind."""
    reason = measures.why_no_measure(context.object)
    grid = layout.grid_flow(row_major=True, columns=3, even_columns=True, align=True)
    for kind, (label, _, icon, *_) in KINDS.items():
        grid.operator("dgs.measure", text=label, icon=icon).kind = kind
    grid.operator("dgs.measure_again", text="Again", icon="FILE_REFRESH")
    layout.prop(context.scene.dgs, "measure_edges", icon="SNAP_EDGE")
    if reason:
        sentence(layout, context, reason, "INFO")
    elif measures.opening():
        layout.label(text="The engine opens the twin...", icon="TIME")


def _draw_list(layout: Any, context: Any, twin: Any, held: Any) -> None:
    """All measures; below, more of the chosen one, and the scale."""
    rows = min(max(len(held.items), _ROWS[0]), _ROWS[1])
    row = layout.row()
    row.template_list(DGS_UL_measures.bl_idname, "", held, "items", held, "active", rows=rows)
    column = row.column(align=True)
    column.operator("dgs.remove_measure", text="", icon="REMOVE")
    column.separator()
    column.operator("dgs.export_measures", text="", icon="EXPORT")
    item, known = active_measure(twin), known_measure(twin)
    if item is not None and item.found:
        span = {"low": f"{item.low:,.4g}", "high": f"{item.high:,.4g}", "unit": item.unit.replace("^2", "²")}
        figures(layout, "95 %: {low} to {high} {unit}", "ARROW_LEFTRIGHT", **span)
    elif item is not None and item.reason:
        sentence(layout, context, in_users_language(item.reason), "ERROR")
    row = layout.row(align=True)
    row.operator("dgs.know_length", icon="DRIVER_DISTANCE")
    row.operator("dgs.scale_by_board", text="Marker Board", icon="MESH_GRID")
    if known is not None or held.board:
        row.operator("dgs.forget_length", text="", icon="X")
    _draw_scale(layout, context, held, known, board_of(twin))


def _draw_scale(layout: Any, context: Any, held: Any, known: Any, board: Any) -> None:
    """Where the scale comes from."""
    if held.trouble:
        sentence(layout, context, in_users_language(held.trouble), "ERROR")
    if known is not None:
        length = {"name": known.name, "length": f"{held.length:.6g}", "unit": held.unit}
        figures(layout, "Scale: {name} is {length} {unit}", "CHECKMARK", **length)
    elif board is not None:
        share = f"{100 * board['deviation'] / board['size']:.2g}"
        counts = {name: board[name] for name in ("markers", "photos")}
        sentence(
            layout,
            context,
            "Scale by {board}: {markers} markers on {photos} photos, known to {share} %",
            "CHECKMARK",
            board=board["board"],
            share=share,
            **counts,
        )
    else:
        sentence(layout, context, iface_("No length is known: px are px-equivalents, px of the photos there"), "INFO")
