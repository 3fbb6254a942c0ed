"""Drawing Blender's window anew: which parts, and how often."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

#: Name of the sidebar's tab.
TAB = "Descatter"
#: Width of a character in px at a scale of 1, and characters that a line has at least.
_CHARACTER, _SHORTEST = 6.2, 20
#: Characters of one text that are shown: a file of somebody's may hold more than a window can draw.
_SHOWN = 600


def wrapped(text: str, width: float) -> list[str]:
    """The lines of a text that is `width` px wide at a scale of 1: labels do not wrap."""
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
    return textwrap.wrap(shown, max(_SHORTEST, int(width / _CHARACTER))) or [""]


def redraw() -> None:
    """The sidebars that show the tab, in all 3D views."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI" and region.width > 1 and _shows_tab(region):
                        region.tag_redraw()


def redraw_views() -> None:
    """All 3D views; that takes longer."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _shows_tab(region: Any) -> bool:
    """Whether a sidebar shows this tab, or a Blender does not say."""
    return getattr(region, "active_panel_category", TAB) in (TAB, "", "UNSUPPORTED")


class Pace:
    """Allows a drawing when the last one is long enough ago, measured by what that one took.

    With a graphics card a drawing takes milliseconds and the least interval counts; without one it takes a
    twentieth of a second or more, and then comes less often.

    Args:
        least, most: seconds between two drawings.
        share: of the time that drawing may take.
    """

    def __init__(self, least: float, most: float, share: float) -> None:
        self._least, self._most, self._share = least, most, share
        self._shown: float | None = None
        #: Seconds that the last drawing took.
        self.cost = 0.0

    @property
    def interval(self) -> float:
        """Seconds that must lie between two drawings now."""
        return min(max(self._least, self.cost / self._share), self._most)

    def due(self, now: float) -> bool:
        """Whether a drawing may be asked for."""
        return self._shown is None or now - self._shown >= self.interval

    def asked(self, now: float) -> None:
        """A drawing was asked for; it happens as soon as this tick is over."""
        self._shown = now

    def drawn(self, now: float) -> None:
        """The drawing that was asked for is done."""
        if self._shown is not None:
            self.cost = max(0.0, now - self._shown)
