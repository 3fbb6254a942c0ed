"""Pictures of twins in 3D views: what each view shows, when it is drawn anew."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import bpy

from ...core.camera import Camera
from ...core.errors import DeviceError, DgsError
from ...core.serving.messages import Blur, PlacedTwin, View
from .card import CardView
from .drawer import drawer, note_failure, the_card
from .follower import Follower
from .process import picture_server
from .quad import Quad
from .through import blur_before
from .twins import placed_twins
from .view_camera import window_camera

#: Seconds between two looks whether a picture has come.
_TICK = 0.01
#: In Edit Mode splats are drawn so much nearer, as a share of the distance from which is looked: Blender's own dots
#: would hide colours. What is selected has a tint.
_BEFORE_POINTS = 0.04
#: Seconds after which an engine that could not draw is tried again.
_RETRY = 30.0


@dataclass
class Shown:
    """One 3D view."""

    follower: Follower
    quad: Quad = field(default_factory=Quad)
    card: CardView | None = None

    @property
    def done(self) -> bool:
        """Whether what is drawn is what the view shows."""
        return self.follower.done if self.card is None else not self.card.waiting


@dataclass(frozen=True)
class Look:
    """How a 3D view shows twins: `View`'s options, and whether they are seen through the scene's medium."""

    depth: bool
    light: bool
    background: tuple[float, float, float] | None = None
    power: float = 0.0
    through: bool = False

    def of(self, twins: tuple[PlacedTwin, ...], camera: Camera, blur: Blur | None) -> View:
        """The view to be asked for."""
        return View(twins, camera, self.depth, self.light, self.background, power=self.power, blur=blur)


_views: dict[int, Shown] = {}


def draw_twins(context: Any, depsgraph: Any, look: Look) -> str:
    """Draws the last picture of the twins into the 3D view that is being drawn, and asks for the next.

    Returns:
        Why there can be none; '' if nothing is wrong.
    """
    region, eye = context.region, context.region_data
    camera, back = window_camera(eye.view_matrix, eye.window_matrix, region.width, region.height)
    nearer = _BEFORE_POINTS * eye.view_distance if context.mode == "EDIT_MESH" else 0.0
    try:
        blur = blur_before(context.scene, camera, back) if look.through else None
        by_card = blur is None and drawer().card
        server = the_card().twins if by_card else picture_server()
        twins = placed_twins(depsgraph, server, context.space_data)
    except DgsError as error:
        return str(error)
    shown = _views.setdefault(region.as_pointer(), Shown(Follower(f"view {region.as_pointer()}")))
    key = twins, look, blur, region.width, region.height, _row(eye.view_matrix), _row(eye.window_matrix)
    if not twins and look.background is None:
        shown.follower.clear()
        return ""
    view = look.of(twins, camera, blur)
    window = eye.window_matrix if look.depth else None
    if by_card:
        return _by_card(shown, key, view, window, back + nearer)
    shown.card = None
    return _by_engine(shown, key, view, window, back + nearer)


def _by_card(shown: Shown, key: object, view: View, window: Any, back: float) -> str:
    if shown.card is None:
        _forget_closed()
        shown.card = CardView()
        shown.follower.clear()
    try:
        shown.card.draw(the_card(), key, view, window, back)
    except DeviceError as error:
        note_failure(error)
        shown.card = None
        return str(error)
    if shown.card.waiting:
        _look_later()
    return ""


def _by_engine(shown: Shown, key: object, view: View, window: Any, back: float) -> str:
    server, now = picture_server(), time.monotonic()
    if server.error and now - server.failed < _RETRY:
        return server.error
    shown.follower.show(key, view, now)
    shown.follower.step(server, now)
    if not shown.follower.done:
        _look_later()
    if shown.follower.picture is not None:
        shown.quad.draw(shown.follower.picture, (view.camera.width, view.camera.height), window, back)
    return server.error


def _look_later() -> None:
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=_TICK, persistent=True)


def forget_views() -> None:
    """Drops all pictures."""
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    _views.clear()


def _tick() -> float | None:
    """Takes pictures that have come, and has their views drawn."""
    regions = _forget_closed()
    now, waiting = time.monotonic(), False
    for number, shown in _views.items():
        if shown.done:
            continue
        if shown.card is not None:
            regions[number].tag_redraw()  # (the order is there as soon as a thread has sorted it)
            waiting = True
            continue
        try:
            server = picture_server()
        except DgsError:
            continue
        if shown.follower.step(server, now):
            regions[number].tag_redraw()
        waiting |= not shown.follower.done and not server.error
    return _TICK if waiting else None


def _forget_closed() -> dict[int, Any]:
    """Lets go of views that were closed; those that are open, by their numbers."""
    regions = {region.as_pointer(): region for region in _regions()}
    for gone in _views.keys() - regions.keys():
        del _views[gone]
    return regions


def _regions() -> list[Any]:
    """The main regions of all 3D views that are open."""
    return [
        region
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "VIEW_3D"
        for region in area.regions
        if region.type == "WINDOW"
    ]


def _row(matrix: Any) -> tuple[float, ...]:
    return tuple(value for row in matrix for value in row)
