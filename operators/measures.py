"""What is done with the measures of a twin: forgotten, made the known length, exported."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.io_utils import ExportHelper

from ..core.errors import DgsError
from ..core.files import write_text
from ..core.measure.boards import parsed_board
from ..core.measure.rows import check_table_name, table_text
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions.measures import answered, ask_again
from ..dgs_addon.scene.measures import (
    UNIT_ITEMS,
    active_measure,
    asked_of,
    known_measure,
    measures_of,
    remove_measure,
    rows_of_table,
)
from ..dgs_addon.window import redraw, redraw_views
from .export_twin import check_place
from .measure import TICK, OfATwin, again

#: Kinds that a known length can be of.
_LENGTHS = ("length", "polyline", "width")
#: The board that is offered first.
USUAL_BOARD = "charuco:4x4_50,7x5,30mm,22mm"


class _OfAMeasure:
    @classmethod
    def poll(cls, context: Any) -> bool:
        """A measure is chosen."""
        cls.poll_message_set("Measure something first")  # type: ignore[attr-defined]
        return active_measure(context.object) is not None


class DGS_OT_remove_measure(_OfAMeasure, bpy.types.Operator):
    """Forget the chosen measure"""

    bl_idname = "dgs.remove_measure"
    bl_label = "Remove Measure"
    bl_options = {"UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Forgets it; without the known one all others are px-equivalents again."""
        twin = context.object
        known = active_measure(twin).known
        remove_measure(twin, twin.dgs_measures.active)
        redraw_views()
        return again(self, twin) if known and twin.dgs_measures.items else {"FINISHED"}


class DGS_OT_know_length(_OfAMeasure, bpy.types.Operator):
    """Give the true length of the chosen measure, which sets the scale of all others"""

    bl_idname = "dgs.know_length"
    bl_label = "Known Length"
    bl_options = {"UNDO"}

    length: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Length", min=1e-9, default=100.0, precision=4, description="What the chosen measure truly is"
    )
    deviation: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Uncertainty",
        min=0.0,
        precision=4,
        description="Standard deviation of the true length: it widens the intervals of all others",
    )
    unit: bpy.props.EnumProperty(name="Unit", items=UNIT_ITEMS)  # type: ignore[valid-type]

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A length is chosen."""
        item = active_measure(context.object)
        cls.poll_message_set("Choose a length, a path or a width first")
        return item is not None and item.kind in _LENGTHS and item.found

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Asks for the length."""
        held = measures_of(context.object)
        if known_measure(context.object) is not None:
            self.length, self.deviation, self.unit = held.length, held.deviation, held.unit
        answer: set[str] = context.window_manager.invoke_props_dialog(self)
        return answer

    def execute(self, context: Any) -> set[str]:
        """Measures all anew, in this unit."""
        twin = context.object
        held, item = twin.dgs_measures, active_measure(twin)
        for other in held.items:
            other.known = other == item
        held.board = held.trouble = ""
        held.length, held.deviation, held.unit = self.length, min(self.deviation, 0.99 * self.length), self.unit
        return again(self, twin)


class DGS_OT_scale_by_board(OfATwin, bpy.types.Operator):
    """Find printed markers of known size on the twin's photos: they set the scale of all measures"""

    bl_idname = "dgs.scale_by_board"
    bl_label = "Scale by Board"
    bl_options = {"UNDO"}

    board: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Marker Board",
        default=USUAL_BOARD,
        description="What was printed: aruco:DICTIONARY,SIDE or charuco:DICTIONARY,COLUMNSxROWS,SQUARE,MARKER",
    )

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Asks what was printed."""
        self.board = measures_of(context.object).board or self.board
        answer: set[str] = context.window_manager.invoke_props_dialog(self)
        return answer

    def execute(self, context: Any) -> set[str]:
        """Asks; without a window the engine is waited for. What was known before is known again if it finds nothing."""
        twin = context.object
        held, known = measures_of(twin), known_measure(twin)
        former = held.board, "" if known is None else known.name
        try:
            board = parsed_board(self.board).text
            held.board, held.trouble = board, ""
            if known is not None:
                known.known = False
            talk = ask_again(twin)
        except DgsError as error:
            _taken_back(twin, former, error)
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        if bpy.app.background:
            _take_board(twin, former, talk.wait("all"))
            if held.trouble:
                self.report({"ERROR"}, in_users_language(held.trouble))
            return {"CANCELLED"} if held.trouble else {"FINISHED"}

        def check() -> float | None:
            answer = talk.take("all")
            if answer is None:
                return TICK
            with contextlib.suppress(ReferenceError):  # the twin may have gone meanwhile
                _take_board(twin, former, answer)
            redraw()
            return None

        bpy.app.timers.register(check, first_interval=TICK)
        return {"FINISHED"}


def _take_board(twin: Any, former: tuple[str, str], answer: dict[str, Any]) -> None:
    """Takes the answer in; the panel shows why where there is no scale."""
    try:
        answered(twin, answer)
    except DgsError as error:
        _taken_back(twin, former, error)
    redraw_views()


def _taken_back(twin: Any, former: tuple[str, str], error: DgsError) -> None:
    held = measures_of(twin)
    held.board, held.trouble = former[0], str(error)
    for item in held.items:
        item.known = bool(former[1]) and item.name == former[1]


class DGS_OT_forget_length(bpy.types.Operator):
    """Measure in px-equivalents again: px of the photos on the surface there"""

    bl_idname = "dgs.forget_length"
    bl_label = "Forget Scale"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A length or a board is known."""
        cls.poll_message_set("No length is known")
        held = measures_of(context.object)
        return held is not None and (known_measure(context.object) is not None or bool(held.board))

    def execute(self, context: Any) -> set[str]:
        """Forgets it."""
        known = known_measure(context.object)
        if known is not None:
            known.known = False
        measures_of(context.object).board = measures_of(context.object).trouble = ""
        return again(self, context.object)


class DGS_OT_export_measures(_OfAMeasure, bpy.types.Operator, ExportHelper):
    """Export all measures of the twin with their intervals, as CSV for spreadsheets or as JSON"""

    bl_idname = "dgs.export_measures"
    bl_label = "Export Measures"

    filename_ext = ".csv"
    check_extension = None  # (.json is as good)
    filter_glob: bpy.props.StringProperty(default="*.csv;*.json", options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: Any) -> set[str]:
        """Writes the file, in the format of its ending."""
        twin, path = context.object, Path(bpy.path.abspath(self.filepath))
        try:
            check_table_name(path)
            check_place(path, context.scene.dgs)
            rows = rows_of_table(twin)
            write_text(path, table_text(rows, path.suffix.lower(), twin=twin.name, asked=asked_of(twin), **_more(twin)))
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("{count} measures in {name}").format(count=len(rows), name=path.name))
        return {"FINISHED"}


def _more(twin: Any) -> dict[str, Any]:
    """Where the places lie, as the engine has said it."""
    try:
        answer = json.loads(twin.dgs_measures.answer)
        return {"places": answer["places"], "noise": answer["noise"]}
    except (ValueError, KeyError, TypeError):
        return {}
