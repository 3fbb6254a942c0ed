"""A layout that writes down what a panel draws: Blender draws none without a window.

It takes every call that Blender's does, as far as our panels make them, and keeps texts, buttons and properties.
"""

from __future__ import annotations

from types import FunctionType, SimpleNamespace
from typing import Any

import bpy


class Paper:
    """What was drawn: `labels` as (text, icon), `buttons` by operator's name with their properties, `props` by name."""

    def __init__(self, page: Paper | None = None) -> None:
        self.labels: list[tuple[str, str]] = [] if page is None else page.labels
        self.buttons: dict[str, list[SimpleNamespace]] = {} if page is None else page.buttons
        self.props: list[str] = [] if page is None else page.props
        self.bars: list[str] = [] if page is None else page.bars
        self.pictures: list[int] = [] if page is None else page.pictures

    def _part(self, *_: Any, **__: Any) -> Paper:
        return Paper(self)

    row = column = box = split = grid_flow = _part

    def panel(self, _name: str, default_closed: bool = False) -> tuple[Paper, Paper]:
        """A part that can be closed, open."""
        return Paper(self), Paper(self)

    def label(self, *, text: str = "", icon: str = "NONE", translate: bool = True) -> None:
        self.labels.append((text, icon))

    def operator(self, name: str, *, text: str | None = None, icon: str = "NONE", **_: Any) -> SimpleNamespace:
        kind = getattr(bpy.types, "DGS_OT_" + name.removeprefix("dgs."), None)
        assert kind is not None or not name.startswith("dgs."), f"no operator {name}"
        button = SimpleNamespace(text=text)
        self.buttons.setdefault(name, []).append(button)
        return button

    def prop(self, owner: Any, name: str, **_: Any) -> None:
        assert name.startswith("[") or hasattr(owner, name), f"no property {name}"
        self.props.append(name)

    def template_list(self, kind: str, _name: str, owner: Any, items: str, chosen: Any, index: str, **_: Any) -> None:
        assert hasattr(bpy.types, kind) and hasattr(owner, items) and hasattr(chosen, index)
        self.props.append(items)

    def progress(self, *, text: str = "", **_: Any) -> None:
        self.bars.append(text)

    def template_icon(self, icon_value: int, scale: float = 1.0) -> None:
        self.pictures.append(icon_value)

    def separator(self, **_: Any) -> None:
        pass

    @property
    def words(self) -> str:
        """All texts, a line each."""
        return "\n".join(text for text, _ in self.labels)


def drawn(panel: type, width: int = 320, method: str = "draw", **changes: Any) -> Paper:
    """What a panel draws in a sidebar of this width in px."""
    paper = Paper()
    own = {name: thing for kind in reversed(panel.__mro__) for name, thing in vars(kind).items()}
    methods = {name: thing for name, thing in own.items() if isinstance(thing, FunctionType | staticmethod)}
    itself = type("Drawn", (), methods)()
    itself.layout = paper
    for name in [name for name in changes if name in getattr(panel, "__annotations__", ())]:  # Blender's properties
        setattr(itself, name, changes.pop(name))
    getattr(itself, method)(context(width, **changes))
    return paper


def context(width: int = 320, **changes: Any) -> Any:
    """Blender's context with a sidebar."""
    given = {
        "scene": bpy.context.scene,
        "object": bpy.context.object,
        "mode": "OBJECT",
        # (without a window Blender has no scale)
        "preferences": SimpleNamespace(system=SimpleNamespace(ui_scale=1.0, use_online_access=False)),
        "region": SimpleNamespace(width=width),
        "view_layer": bpy.context.view_layer,
    }
    return SimpleNamespace(**{**given, **changes})
