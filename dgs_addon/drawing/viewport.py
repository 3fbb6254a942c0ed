"""Pictures of twins in 3D views: what each view shows, when it is drawn anew."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import bpy

from ...core.camera import Camera
from ...core.errors import DgsError
from ...core.serving.messages import Blur, PlacedTwin, View
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
    try:
        server = picture_server()
        twins = placed_twins(depsgraph, server, context.space_data)
        camera, back = window_camera(eye.view_matrix, eye.window_matrix, region.width, region.height)
        blur = blur_before(context.scene, camera, back) if look.through else None
    except DgsError as error:
        return str(error)
    now = time.monotonic()
    if server.error and now - server.failed < _RETRY:
        return server.error
    shown = _views.setdefault(region.as_pointer(), Shown(Follower(f"view {region.as_pointer()}")))
    key = twins, look, blur, region.width, region.height, _row(eye.view_matrix), _row(eye.window_matrix)
    if not twins and look.background is None:
        shown.follower.clear()
        return ""
    shown.follower.show(key, look.of(twins, camera, blur), now)
    shown.follower.step(server, now)
    if not shown.follower.done and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=_TICK, persistent=True)
    if shown.follower.picture is not None:
        size = region.width, region.height
        if context.mode == "EDIT_MESH":
            back += _BEFORE_POINTS * eye.view_distance
        shown.quad.draw(shown.follower.picture, size, eye.window_matrix if look.depth else None, back)
    return server.error


def forget_views() -> None:
    """Drops all pictures."""
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    _views.clear()


def _tick() -> float | None:
    """Takes pictures that have come, and has their views drawn."""
    regions = {region.as_pointer(): region for region in _regions()}
    for gone in _views.keys() - regions.keys():
        del _views[gone]
    try:
        server = picture_server()
    except DgsError:
        return None
    now, waiting = time.monotonic(), False
    for number, shown in _views.items():
        if shown.follower.done:
            continue
        if shown.follower.step(server, now):
            regions[number].tag_redraw()
        waiting |= not shown.follower.done and not server.error
    return _TICK if waiting else None


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
