"""The engine's own picture of a twin through the scene's camera: the sorted blending it was trained with.

The process that draws all views makes it, at the camera's full resolution, sharp and through the medium. A twin that
was moved, turned or scaled as a whole is seen as it stands: the camera is carried into the twin's own axes instead.

The pictures belong to their scene (`scene.dgs.exact_view` is the one that was asked for, `exact_other` the other kind),
are packed into the file, and remember of what they were made (`scene.dgs.exact_of`): the panel says when that has
changed.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from ...core.background import BLACK
from ...core.camera import Camera
from ...core.serving.messages import Blur, View
from ..axes import camera_to_engine, matrix_to_blender, read_settings, render_size
from ..drawing.picture_server import Picture, PictureServer
from ..drawing.process import picture_server
from ..drawing.twins import whole_twin
from ..job import pictures
from ..scene.medium import photo_focal, psf_before
from ..scene.twin import BASE, OWN_BASE

#: Images that the picture that was asked for and the other one go to.
IMAGE, OTHER = "Descatter Exact View", "Descatter Exact View, Other"
#: Seconds between two checks whether the picture is there.
_TICK = 0.02
#: Splats that stand for all where it is asked whether the twin has changed.
_SAMPLES = 64
#: Settings that a blurred picture depends on.
_MEDIUM = ("medium", "sigma", "sigma_minor", "angle", "psf_file", "blur_space")
#: Comparisons that show one.
_WITH_MEDIUM = ("medium", "difference")


class ExactView:
    """Pictures of one view that are being made.

    Args:
        server: makes them.
        views: by kind, the one that was asked for first.
        scene: `session_uid` of the scene that asked.
        subject: what they are pictures of, see `subject_of`.

    Attributes:
        error: what went wrong; '' while it works and if all went well.
        image: the `bpy` image, once it is there.
    """

    def __init__(self, server: PictureServer, views: dict[str, View], scene: int, subject: str) -> None:
        self.error, self.ended = "", False
        self.image: Any = None
        self.scene, self.subject = scene, subject
        self._server, self._kinds = server, list(views)
        self._made: dict[str, Picture] = {}
        for kind, view in views.items():
            server.take(_channel(kind))  # of one that nobody waited for
            server.ask(_channel(kind), view)

    def drain(self) -> None:
        """Takes in what has come; on the main thread."""
        for kind in self._kinds:
            picture = None if self.ended or kind in self._made else self._server.take(_channel(kind))
            if picture is not None:
                self._made[kind] = picture
            elif not self.ended and kind not in self._made and not self._server.waiting(_channel(kind)):
                # (it may have come between the two looks)
                late = self._server.take(_channel(kind))
                if late is None:
                    self.error, self.ended = self._server.error or "The engine made no picture", True
                else:
                    self._made[kind] = late
        if not self.ended and len(self._made) == len(self._kinds):
            self.ended = True
            self._keep()

    def _keep(self) -> None:
        """Puts the pictures into the scene's images; nothing happens if the scene is gone."""
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == self.scene), None)
        if scene is None:
            return
        for kind, field, name in zip(self._kinds, ("exact_view", "exact_other"), (IMAGE, OTHER), strict=False):
            _fill(_image(scene, field, name), self._made[kind])
        if len(self._kinds) == 1:
            scene.dgs.exact_other = None
        scene.dgs.exact_of = self.subject
        self.image = scene.dgs.exact_view
        show_icon(self.image)


def _channel(kind: str) -> str:
    return f"exact {kind}"


def _image(scene: Any, field: str, name: str) -> Any:
    """The scene's own image of this use."""
    image = getattr(scene.dgs, field)
    if image is None or any(getattr(other.dgs, field) == image for other in bpy.data.scenes if other != scene):
        image = bpy.data.images.new(name, 1, 1)
        setattr(scene.dgs, field, image)
    return image


def _fill(image: Any, picture: Picture) -> None:
    """Gives an image a picture's pixels, as a file of 8 bits has them, and packs it."""
    height, width = picture.pixels.shape[:2]
    if tuple(image.size) != (width, height):
        image.scale(width, height)
    rounded = np.round(np.clip(picture.pixels, 0.0, 1.0) * 255.0).astype(np.float32) / np.float32(255.0)
    image.pixels.foreach_set(np.ascontiguousarray(rounded).reshape(-1))
    image.update()
    image.pack()
    image.filepath_raw = f"//{image.name}.png"  # where it goes if somebody unpacks it


_view: ExactView | None = None


def busy() -> bool:
    """Whether a picture is being made."""
    return _view is not None and not _view.ended


def start(twin: Any, scene: Any, done: Callable[[ExactView], None]) -> ExactView:
    """Asks the engine for the pictures; `done` is called on the main thread when they are there, or are not.

    Raises:
        DgsError: the medium of the settings is incomplete, the twin cannot be read, or there is no engine.
    """
    global _view
    settings, server = scene.dgs, picture_server()
    sharp = View((whole_twin(twin, server),), camera_in(twin, scene), background=BLACK)
    views = {"sharp": sharp}
    psf = psf_before(twin, settings)
    if psf != "none":
        focal = photo_focal(twin, scene.camera)
        step = 1.0 if focal is None else focal / sharp.camera.fx
        views["medium"] = replace(sharp, blur=Blur(psf, settings.blur_space, step))
    if settings.view_kind == "medium":
        views = {"medium": views.get("medium", sharp), **views}
    view = _view = ExactView(server, views, scene.session_uid, subject_of(twin, scene))

    def tick() -> float | None:
        view.drain()
        if view.ended:
            done(view)
        return None if view.ended else _TICK

    if not bpy.app.background:
        bpy.app.timers.register(tick, first_interval=_TICK, persistent=True)
    return view


def stop() -> None:
    """Forgets what is being made, as when the add-on is switched off."""
    global _view
    if _view is not None:
        _view.ended = True
    _view = None


@bpy.app.handlers.persistent
def go_on(_file: Any = None) -> None:
    """After a file was loaded: the panel shows the pictures that it holds."""
    for scene in bpy.data.scenes:
        if scene.dgs.exact_view is not None:
            show_icon(scene.dgs.exact_view)


def show_icon(image: Any) -> None:
    """Makes the panel's icon of a picture; there is none without a window."""
    if not bpy.app.background:
        pictures.show_image(image, icon_name(image))


def icon_name(image: Any) -> str:
    """Name of the picture's icon."""
    return f"{IMAGE} {image.session_uid}"


def is_outdated(twin: Any, scene: Any) -> bool:
    """Whether the twin, the camera or what is asked for has changed since the scene's pictures were made."""
    settings = scene.dgs
    was, is_now = (str(subject).partition(" ") for subject in (settings.exact_of, subject_of(twin, scene)))
    blurred = settings.view_kind == "medium" or (settings.split_shown and settings.split_against in _WITH_MEDIUM)
    return was[0] != is_now[0] or (blurred and was[2] != is_now[2])


def subject_of(twin: Any, scene: Any) -> str:
    """What pictures would show, shortened to a few letters: of the view, and of the medium before it.

    Cheap enough for a panel, so few splats stand for all.
    """
    settings, mesh = scene.dgs, getattr(twin, "data", None)
    if mesh is None or scene.camera is None or scene.camera.type != "CAMERA":
        return ""
    camera = camera_in(twin, scene)
    count = len(mesh.vertices)
    parts: list[Any] = [settings.view_kind, count, camera.width, camera.height]
    figures = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.rotation.flat, *camera.translation]
    for name, field in (("position", "vector"), (OWN_BASE if OWN_BASE in mesh.attributes else BASE, "color")):
        values = mesh.attributes[name].data if name in mesh.attributes else ()
        chosen = range(0, len(values), max(1, len(values) // _SAMPLES))
        figures += [value for index in chosen for value in getattr(values[index], field, ())]
    text = repr(parts) + " ".join(f"{round(value, 6) + 0.0:.4g}" for value in figures)  # (no -0, no 1e-17)
    medium = repr([getattr(settings, name) for name in _MEDIUM])
    return f"{zlib.crc32(text.encode()):08x} {zlib.crc32(medium.encode()):08x}"


def camera_in(twin: Any, scene: Any) -> Camera:
    """The scene's camera as the engine sees it among the twin's own Gaussians."""
    thing, render = scene.camera, scene.render
    relative = np.array(twin.matrix_world.inverted() @ thing.matrix_world, dtype=np.float64)
    relative[:3, :3] /= np.linalg.norm(relative[:3, :3], axis=0)  # a scaled twin leaves the camera its axes
    settings = replace(read_settings(thing, render), matrix_world=matrix_to_blender(relative))
    return camera_to_engine(settings, *render_size(render), "view")
