"""The engine's own picture of a twin through the scene's camera: the sorted blending it was trained with.

The engine runs beside the window, as for a job. A twin that was moved, turned or scaled as a whole is
seen as it stands: the camera is carried into the twin's own axes instead.

The picture belongs to its scene (`scene.dgs.exact_view`), is packed into the file, and remembers of what it was made
(`scene.dgs.exact_of`): the panel says when that has changed.
"""

from __future__ import annotations

import contextlib
import queue
import shutil
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.camera import Camera
from ...core.formats.ply import write_ply
from ...core.formats.transforms import write_transforms
from ..axes import camera_to_engine, matrix_to_blender, read_settings, render_size
from ..engine.process import RUN
from ..job import pictures
from ..job.state import ending
from ..job.worker import Ended, Worker
from ..scene.medium import psf_before
from ..scene.twin import BASE, OWN_BASE, read_twin

#: Image that the picture goes to.
IMAGE = "Descatter Exact View"
#: Seconds between two checks whether the picture is there.
_TICK = 0.1
_NAME = "view.png"
#: Splats that stand for all where it is asked whether the twin has changed.
_SAMPLES = 64
#: Settings that a blurred picture depends on.
_MEDIUM = ("medium", "sigma", "sigma_minor", "angle", "psf_file", "blur_space")


class ExactView:
    """One picture that is made.

    Attributes:
        error: what went wrong; '' while it works and if all went well.
        image: the `bpy` image, once it is there.
        scene: `session_uid` of the scene that asked.
        subject: what it is a picture of, see `subject_of`.
    """

    def __init__(self, worker: Worker, folder: Path, scene: int, subject: str) -> None:
        self.error, self.ended = "", False
        self.image: Any = None
        self.scene, self.subject = scene, subject
        self._worker, self._folder = worker, folder
        self._said = ""

    def drain(self) -> None:
        """Takes in the engine's events; on the main thread."""
        with contextlib.suppress(queue.Empty):
            while not self.ended:
                message = self._worker.events.get_nowait()
                if isinstance(message, Ended):
                    self._end(message.status)
                elif isinstance(message, dict) and message.get("event") == "error":
                    self._said = str(message.get("text", ""))

    def stop(self) -> None:
        """Ends the engine."""
        self._worker.kill()
        self._worker.join(5.0)

    def _end(self, status: int) -> None:
        self.ended = True
        self.error = ending(status, self._said, False)[1]
        if not self.error:
            try:
                self.image = self._keep((self._folder / "out" / _NAME).read_bytes())
            except (OSError, RuntimeError) as error:
                self.error = f"The engine's picture cannot be read ({error}). Try it again."
        self.forget()

    def _keep(self, content: bytes) -> Any:
        """The scene's image of the exact view with this content; None if the scene is gone."""
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == self.scene), None)
        if scene is None:
            return None
        settings, image = scene.dgs, scene.dgs.exact_view
        if image is None or any(other.dgs.exact_view == image for other in bpy.data.scenes if other != scene):
            image = settings.exact_view = bpy.data.images.new(IMAGE, 1, 1)
        image.source = "GENERATED"
        image.pack(data=content, data_len=len(content))
        image.source = "FILE"  # reads it
        image.filepath_raw = f"//{IMAGE}.png"  # where it goes if somebody unpacks it
        settings.exact_of = self.subject
        show_icon(image)
        return image

    def forget(self) -> None:
        """Removes its files."""
        shutil.rmtree(self._folder, ignore_errors=True)


_view: ExactView | None = None


def busy() -> bool:
    """Whether a picture is being made."""
    return _view is not None and not _view.ended


def start(twin: Any, scene: Any, python: Path, done: Callable[[ExactView], None]) -> ExactView:
    """Asks the engine for a picture; `done` is called on the main thread when it is there, or is not.

    Raises:
        DgsError: the medium of the settings is incomplete, or the twin cannot be written.
    """
    global _view
    settings = scene.dgs
    blur = ["--psf", psf_before(twin, settings), "--blur-space", settings.blur_space]
    folder = Path(tempfile.mkdtemp(prefix="descatter-", dir=bpy.app.tempdir or None))
    write_ply(folder / "twin.ply", read_twin(twin))
    write_transforms(folder / "transforms.json", {_NAME: camera_in(twin, scene)})
    command = [
        str(python),
        str(RUN),
        "render",
        str(folder / "twin.ply"),
        "--cameras",
        str(folder / "transforms.json"),
        "--out",
        str(folder / "out"),
        "--progress",
        "json",
        "--control",
        *(blur if settings.view_kind == "medium" else []),
    ]
    worker = Worker(command, folder / "log.txt")
    view = _view = ExactView(worker, folder, scene.session_uid, subject_of(twin, scene))
    worker.start()

    def tick() -> float | None:
        view.drain()
        if view.ended:
            done(view)
        return None if view.ended else _TICK

    if not bpy.app.background:
        bpy.app.timers.register(tick, first_interval=_TICK, persistent=True)
    return view


def stop() -> None:
    """Ends what runs, as when the add-on is switched off."""
    global _view
    if _view is not None and not _view.ended:
        _view.stop()
        _view.ended = True
        _view.forget()
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
    """Whether the twin, the camera or what is asked for has changed since the scene's picture was made."""
    return bool(scene.dgs.exact_of != subject_of(twin, scene))


def subject_of(twin: Any, scene: Any) -> str:
    """What a picture would show, shortened to a few letters: cheap enough for a panel, so few splats stand for all."""
    settings, mesh = scene.dgs, getattr(twin, "data", None)
    if mesh is None or scene.camera is None or scene.camera.type != "CAMERA":
        return ""
    camera = camera_in(twin, scene)
    count = len(mesh.vertices)
    parts: list[Any] = [settings.view_kind, count, camera.width, camera.height]
    if settings.view_kind == "medium":
        parts += [getattr(settings, name) for name in _MEDIUM]
    figures = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.rotation.flat, *camera.translation]
    for name, field in (("position", "vector"), (OWN_BASE if OWN_BASE in mesh.attributes else BASE, "color")):
        values = mesh.attributes[name].data if name in mesh.attributes else ()
        chosen = range(0, len(values), max(1, len(values) // _SAMPLES))
        figures += [value for index in chosen for value in getattr(values[index], field, ())]
    text = repr(parts) + " ".join(f"{round(value, 6) + 0.0:.4g}" for value in figures)  # (no -0, no 1e-17)
    return f"{zlib.crc32(text.encode()):08x}"


def camera_in(twin: Any, scene: Any) -> Camera:
    """The scene's camera as the engine sees it among the twin's own Gaussians."""
    thing, render = scene.camera, scene.render
    relative = np.array(twin.matrix_world.inverted() @ thing.matrix_world, dtype=np.float64)
    relative[:3, :3] /= np.linalg.norm(relative[:3, :3], axis=0)  # a scaled twin leaves the camera its axes
    settings = replace(read_settings(thing, render), matrix_world=matrix_to_blender(relative))
    return camera_to_engine(settings, *render_size(render), _NAME)
