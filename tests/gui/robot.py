"""Runs inside Blender: finds buttons by pointing at them, presses them, takes pictures. For `story.py`.

A story is a generator that yields how many seconds to let Blender go on; a timer resumes it.
"""

from __future__ import annotations

import subprocess
import time
import traceback
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

Story = Generator[float, None, None]


@dataclass(frozen=True)
class Tick:
    """From one tick of a 0.05 s timer to the next.

    Attributes:
        gap: seconds.
        worked: seconds of processor time that all threads of Blender took in it.
        drawn: whether the sidebar or the view was drawn in it.
    """

    gap: float
    worked: float
    drawn: bool


class Robot:
    """What a story may do.

    Args:
        pictures: folder for screenshots.
    """

    def __init__(self, pictures: Path) -> None:
        self.pictures = pictures
        #: Clicks so far, and the tick of the last one.
        self.clicks = self.clicked = 0
        self.ticks: list[Tick] = []
        self._before: tuple[float, float] | None = None
        self._drew = False

    def play(self, story: Story, done: Callable[[str], None]) -> None:
        """Plays a story; `done` gets '' or its error, and Blender ends."""

        def resume() -> float | None:
            try:
                return next(story)
            except StopIteration:
                done("")
            except Exception:  # noqa: BLE001 (the test shows it)
                done(traceback.format_exc())
            bpy.ops.wm.quit_blender()
            return None

        bpy.app.timers.register(resume, first_interval=1.0, persistent=True)

    def measure(self) -> None:
        """Starts a timer of 0.05 s; `ticks` are its ticks."""

        def tick() -> float:
            now, worked = time.perf_counter(), time.process_time()
            if self._before is not None:
                self.ticks.append(Tick(now - self._before[0], worked - self._before[1], self._drew))
            self._before, self._drew = (now, worked), False
            return 0.05

        def drew() -> None:
            self._drew = True

        for region in ("WINDOW", "UI"):
            bpy.types.SpaceView3D.draw_handler_add(drew, (), region, "POST_PIXEL")
        bpy.app.timers.register(tick, persistent=True)

    def area(self) -> Any:
        """The 3D view."""
        return next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")

    def sidebar(self) -> Any:
        """Its sidebar."""
        return next(region for region in self.area().regions if region.type == "UI")

    def open_tab(self, name: str, width: int = 0) -> Story:
        """Opens the sidebar at a tab."""
        self.area().spaces.active.show_region_ui = True
        yield 0.5
        self.sidebar().active_panel_category = name
        self.sidebar().tag_redraw()
        yield 1.0

    def key(self, name: str) -> None:
        """Presses a key."""
        _xdotool("key", name)

    def point(self, x: int, y: int) -> Story:
        """Moves the mouse there."""
        _xdotool("mousemove", x, y)
        yield 0.3

    def drag(self, way: list[tuple[int, int]]) -> Story:
        """Moves the mouse along a way with its left button down."""
        yield from self.point(*way[0])
        _xdotool("mousedown", 1)
        yield 0.2
        for (x, y), (u, v) in zip(way, way[1:], strict=False):
            for step in range(1, 9):
                _xdotool("mousemove", x + (u - x) * step // 8, y + (v - y) * step // 8)
                yield 0.05
        _xdotool("mouseup", 1)
        yield 0.3

    def picture(self, name: str, out_of_the_way: bool = True) -> Story:
        """Takes a screenshot; the mouse is out of the way, unless that would close what is to be seen."""
        if out_of_the_way:
            _xdotool("mousemove", 5, 880)
        yield 0.6
        target = self.pictures / f"{name}.png"
        command = f"xwd -root -silent | convert xwd:- '{target}'"
        taking = subprocess.Popen(["sh", "-c", command])
        while taking.poll() is None:  # Blender's own time is measured: it must not wait for this
            yield 0.05
        if taking.returncode:
            raise RuntimeError(f"no picture {name}")

    def click(self) -> None:
        """Presses the left button where the mouse is."""
        self.clicked = len(self.ticks)
        _xdotool("click", 1)
        self.clicks += 1

    def press(self, operator: str, across: float = 0.33) -> Story:
        """Clicks the sidebar's button of an operator ('dgs.optimize'); scrolls to it if need be.

        Args:
            across: where in the sidebar's width it is; the left one of two beside each other if not given.

        Raises:
            LookupError: there is no such button.
        """
        yield from self.reach(operator, across)
        self.click()
        yield 0.5

    def reach(self, operator: str, across: float = 0.33) -> Story:
        """Points at the sidebar's button of an operator; scrolls to it if need be. Raises as `press`."""
        for attempt in range(14):
            place: list[int] = []
            yield from self._find(operator, place, across)
            if place:
                _xdotool("mousemove", *place)
                yield 0.3
                return
            _xdotool("mousemove", *self._point(0.5))
            if attempt == 0:  # from the top on, then downwards
                _xdotool("click", "--repeat", 60, "--delay", 10, 4)
            else:
                _xdotool("click", "--repeat", 5, "--delay", 30, 5)
            yield 1.5
        raise LookupError(f"the sidebar has no button {operator}")

    def scroll(self, clicks: int) -> Story:
        """Turns the wheel down over the sidebar."""
        _xdotool("mousemove", *self._point(0.5))
        _xdotool("click", "--repeat", clicks, "--delay", 30, 5)
        yield 1.0

    def _find(self, operator: str, place: list[int], across: float) -> Story:
        region, window = self.sidebar(), bpy.context.window_manager.windows[0]
        x = region.x + round(across * region.width)
        for y in range(region.y + region.height - 12, region.y + 8, -14):
            _xdotool("mousemove", x, window.height - y)
            yield 0.12
            if self._below_mouse() == operator:
                place[:] = [x, window.height - y]
                return

    def _below_mouse(self) -> str:
        """'dgs.optimize' if the mouse is above that button; Blender says what it would run."""
        window = bpy.context.window_manager.windows[0]
        with bpy.context.temp_override(window=window, area=self.area(), region=self.sidebar()):
            if not bpy.ops.ui.copy_python_command_button.poll():
                return ""
            bpy.ops.ui.copy_python_command_button()
        return bpy.context.window_manager.clipboard.removeprefix("bpy.ops.").partition("(")[0]

    def _point(self, share: float) -> tuple[int, int]:
        region, window = self.sidebar(), bpy.context.window_manager.windows[0]
        return region.x + region.width // 2, window.height - region.y - round(region.height * share)


def _xdotool(*arguments: object) -> None:
    subprocess.run(["xdotool", *map(str, arguments)], check=True)
