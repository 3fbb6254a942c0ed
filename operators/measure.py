"""Measures a twin: places set with the mouse, or given by a script."""

from __future__ import annotations

import contextlib
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from mathutils import Vector

from ..core.errors import DgsError, FormatError
from ..dgs_addon.drawing.measures import Pending, set_pending
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions.measures import answered, ask_again, conversation, why_no_measure
from ..dgs_addon.scene.measures import KIND_ITEMS, KINDS, add_measure, given_place, remove_measure, sight_line
from ..dgs_addon.scene.twin import is_twin
from ..dgs_addon.window import redraw, redraw_views

#: Seconds between two looks whether the engine has answered.
TICK = 0.03
#: Events that turn the view, or move it, while something is measured.
_VIEW = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "MOUSEROTATE"}


#: Parts of the window that lie over the view and take clicks.
_PARTS = {"UI", "TOOLS", "HEADER", "TOOL_HEADER"}


class OfATwin:
    """What needs a twin that can be measured."""

    @classmethod
    def poll(cls, context: Any) -> bool:
        """The active object is a twin that comes from a folder of results, and there is an engine."""
        reason = why_no_measure(context.object)
        cls.poll_message_set(reason)  # type: ignore[attr-defined]
        return not reason


class DGS_OT_measure(OfATwin, bpy.types.Operator):
    """Measure between places on the twin: click on its surface, Esc gives up. Values come with their 95 % interval"""

    bl_idname = "dgs.measure"
    bl_label = "Measure"
    bl_options = {"UNDO"}

    kind: bpy.props.EnumProperty(name="Kind", items=KIND_ITEMS)  # type: ignore[valid-type]
    name: bpy.props.StringProperty(name="Name", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    points: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Points",
        options={"SKIP_SAVE"},
        description="Positions in the scene instead of clicks: 'x y z; x y z; ...'",
    )

    def execute(self, context: Any) -> set[str]:
        """For scripts: measures between given positions, and waits for the engine."""
        twin = context.object
        try:
            places = [given_place(twin, point) for point in _parsed(self.points)]
            _check_count(self.kind, len(places))
            talk = conversation(twin)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        item = add_measure(twin, self.kind, places, self._name())
        try:
            ask_again(twin)
            answered(twin, talk.wait("all"))
            if not item.found:
                raise FormatError(item.reason.rstrip("."))
        except DgsError as error:
            remove_measure(twin, len(twin.dgs_measures.items) - 1)
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Begins to listen to the mouse."""
        if self.points:
            return self.execute(context)
        area = context.area
        if area is None or area.type != "VIEW_3D":
            self.report({"ERROR"}, rpt_("This is no 3D view"))
            return {"CANCELLED"}
        try:
            self._talk = conversation(context.object)
        except DgsError as error:
            self.report({"ERROR"}, in_users_language(str(error)))
            return {"CANCELLED"}
        self._region = next(region for region in area.regions if region.type == "WINDOW")
        self._view = area.spaces.active.region_3d
        self._area, self._twin = area, context.object
        self._lines: list[dict[str, Any]] = []
        self._clicked: dict[str, Any] | None = None
        self._ending = False
        self._now = Pending(context.object, self.kind, region=self._region)
        set_pending(self._now)
        self._timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("CROSSHAIR")
        self._say(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """The mouse moves, a button goes down, or the engine has answered."""
        try:
            if not is_twin(self._twin):
                raise ReferenceError
        except ReferenceError:
            return self._end(context, {"CANCELLED"})
        if event.type == "TIMER":
            return self._answers(context)
        turning = event.type in _VIEW or (event.alt and event.type in {"LEFTMOUSE", "MOUSEMOVE"})
        if turning or (event.type != "ESC" and self._elsewhere(event)):
            return {"PASS_THROUGH"}
        if event.type == "ESC" and event.value == "PRESS":
            return self._end(context, {"CANCELLED"})
        if not self._ending:
            if event.type in {"RET", "NUMPAD_ENTER", "RIGHTMOUSE"} and event.value == "PRESS":
                return self._enough(context)
            if event.type == "BACK_SPACE" and event.value == "PRESS" and self._lines:
                self._lines.pop()
                self._now.places.pop()
                redraw_views()
            self._mouse(context, event)
            self._say(context)
        return {"RUNNING_MODAL"}

    def _elsewhere(self, event: Any) -> bool:
        """Whether the mouse is over the sidebar or another part that lies over the view."""
        return any(
            region.type in _PARTS
            and region.width > 1
            and 0 <= event.mouse_x - region.x < region.width
            and 0 <= event.mouse_y - region.y < region.height
            for region in self._area.regions
        )

    def _mouse(self, context: Any, event: Any) -> None:
        """Asks what lies under it, and what was clicked on."""
        x, y = event.mouse_x - self._region.x, event.mouse_y - self._region.y
        if not (0 <= x < self._region.width and 0 <= y < self._region.height) or self._clicked is not None:
            return
        if event.type == "MOUSEMOVE":
            self._now.mouse = (x, y)
            self._talk.ask("hover", {"places": {"p": self._line(context, x, y)}})
            redraw_views()
        elif event.type == "LEFTMOUSE" and event.value == "PRESS":
            self._now.mouse = (x, y)
            self._clicked = self._line(context, x, y)
            self._talk.ask("click", {"places": {"p": self._clicked}})

    def _line(self, context: Any, x: float, y: float) -> dict[str, Any]:
        """The line of sight through a px of the region, as the engine takes it."""
        origin = region_2d_to_origin_3d(self._region, self._view, (x, y))
        ways = [region_2d_to_vector_3d(self._region, self._view, (x + step, y)).normalized() for step in (0, 1)]
        if self._view.is_perspective:
            spread = (ways[1] - ways[0]).length
        else:
            beside = region_2d_to_origin_3d(self._region, self._view, (x + 1, y))
            spread = (beside - origin).length / max((self._view.view_location - origin).length, 1e-9)
        far = max((Vector(self._twin.matrix_world.translation) - origin).length, 1e-3)
        # the ends of a profile across a crack lie beside it
        edges = bool(context.scene.dgs.measure_edges) and self.kind != "width"
        return sight_line(self._twin, origin, origin + far * ways[0], min(spread, 0.5), edges)

    def _answers(self, context: Any) -> set[str]:
        """Takes in what has come; on the main thread."""
        clicked, hover = self._talk.take("click"), self._talk.take("hover")
        if self._talk.error:
            self.report({"ERROR"}, in_users_language(self._talk.error))
            return self._end(context, {"CANCELLED"})
        if self._ending:
            answer = self._talk.take("all")
            return {"RUNNING_MODAL"} if answer is None else self._measured(context, answer)
        if hover is not None:
            self._now.hover = _position(hover)
            redraw_views()
        if clicked is not None and self._clicked is not None:
            line, self._clicked = self._clicked, None
            position = _position(clicked)
            if position is None:
                self.report({"WARNING"}, rpt_("Nothing is there: the twin has no surface where you clicked"))
            else:
                self._lines.append(line)
                self._now.places.append(position)
                self._now.hover = None
            redraw_views()
            if len(self._lines) == KINDS[self.kind][4]:
                return self._enough(context)
        self._say(context)
        return {"RUNNING_MODAL"}

    def _enough(self, context: Any) -> set[str]:
        """All places are set: they are measured, if they are enough."""
        if len(self._lines) < KINDS[self.kind][3]:
            return self._end(context, {"CANCELLED"})
        self._ending = True
        add_measure(self._twin, self.kind, self._lines, self._name())
        self._now.hover = None
        ask_again(self._twin)
        self._say(context)
        return {"RUNNING_MODAL"}

    def _measured(self, context: Any, answer: dict[str, Any]) -> set[str]:
        item = self._twin.dgs_measures.items[-1]
        try:
            answered(self._twin, answer)
            if not item.found:
                raise FormatError(item.reason.rstrip("."))
        except DgsError as error:
            self._ending = False  # (nothing to take back a second time)
            remove_measure(self._twin, len(self._twin.dgs_measures.items) - 1)
            self.report({"ERROR"}, in_users_language(str(error)))
            return self._end(context, {"CANCELLED"})
        self._ending = False
        return self._end(context, {"FINISHED"})

    def _end(self, context: Any, how: set[str]) -> set[str]:
        if self._ending:  # given up while the engine measures
            remove_measure(self._twin, len(self._twin.dgs_measures.items) - 1)
        set_pending(None)
        context.window_manager.event_timer_remove(self._timer)
        context.window.cursor_modal_restore()
        self._area.header_text_set(None)
        redraw_views()
        redraw()
        return how

    def _say(self, context: Any) -> None:
        """What happens, in the view's header and beside the mouse."""
        least, most = KINDS[self.kind][3:]
        if not self._talk.ready:
            words = rpt_("The engine opens the twin...")
        elif self._ending:
            words = rpt_("Measuring...")
        elif most > least and len(self._lines) >= least:
            words = rpt_("Set place {number}, or Enter").format(number=len(self._lines) + 1)
        else:
            words = rpt_("Set place {number} of {count}").format(number=len(self._lines) + 1, count=least)
        keys = rpt_("{words}   |   Click: set   |   Backspace: take back   |   Esc: give up").format(words=words)
        if self._now.words != words:
            self._now.words = words
            redraw_views()
        self._area.header_text_set(keys)

    def _name(self) -> str:
        return self.name or str(rpt_(KINDS[self.kind][0]))


class DGS_OT_measure_again(OfATwin, bpy.types.Operator):
    """Measure all places again, on the twin as its folder has it now"""

    bl_idname = "dgs.measure_again"
    bl_label = "Measure Again"
    bl_options = {"UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Asks; without a window the engine is waited for."""
        return again(self, context.object)


def again(operator: Any, twin: Any) -> set[str]:
    """Asks for all measures of a twin; without a window the engine is waited for."""
    try:
        talk = ask_again(twin)
        if bpy.app.background:
            answered(twin, talk.wait("all"))
    except DgsError as error:
        operator.report({"ERROR"}, in_users_language(str(error)))
        return {"CANCELLED"}
    if not bpy.app.background:

        def check() -> float | None:
            answer = talk.take("all")
            if answer is None:
                return TICK
            with contextlib.suppress(DgsError, ReferenceError):  # the twin may have gone meanwhile
                answered(twin, answer)
            redraw()
            redraw_views()
            return None

        bpy.app.timers.register(check, first_interval=TICK)
    return {"FINISHED"}


def _position(answer: dict[str, Any]) -> list[float] | None:
    """Where the place lies that was asked for; None where nothing is."""
    place = answer.get("places", {}).get("p") if answer.get("event") == "measured" else None
    return None if place is None else list(place["position"])


def _parsed(points: str) -> list[tuple[float, float, float]]:
    found = []
    for part in points.split(";"):
        try:
            x, y, z = (float(word) for word in part.replace(",", " ").split())
        except ValueError as error:
            raise FormatError(f"'{part.strip()[:60]}' is no position", "Write three numbers for each: x y z") from error
        found.append((x, y, z))
    return found


def _check_count(kind: str, count: int) -> None:
    label, _, _, least, most = KINDS[kind]
    if not least <= count <= most:
        raise FormatError(f"'{label}' is of {least} places{'' if least == most else ' or more'}, not of {count}")
