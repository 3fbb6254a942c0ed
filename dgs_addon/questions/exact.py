"""The engine's own picture of a twin through the scene's camera: the sorted blending it was trained with.

The engine runs beside the window, as for a job. A twin that was moved, turned or scaled as a whole is
seen as it stands: the camera is carried into the twin's own axes instead.
"""

from __future__ import annotations

import contextlib
import queue
import shutil
import tempfile
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
from ..job.request import ESTIMATED_FROM_PHOTOS, psf_argument
from ..job.state import ending
from ..job.worker import Ended, Worker
from ..scene.twin import read_twin

#: Image that the picture goes to.
IMAGE = "Descatter Exact View"
#: Seconds between two checks whether the picture is there.
_TICK = 0.1
_NAME = "view.png"


class ExactView:
    """One picture that is made.

    Attributes:
        error: what went wrong; '' while it works and if all went well.
        image: the `bpy` image, once it is there.
    """

    def __init__(self, worker: Worker, folder: Path) -> None:
        self.error, self.ended = "", False
        self.image: Any = None
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
            # Blender reads the image again when it likes: the file stays until there is another.
            kept = self._folder / f"{IMAGE}.png"
            try:
                shutil.move(self._folder / "out" / _NAME, kept)
                self.image = pictures.show(kept, IMAGE)
            except (OSError, RuntimeError) as error:
                self.error = f"The engine's picture cannot be read ({error}). Try it again."
        if self.error:
            self.forget()

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
    psf = str(twin.get("dgs_psf", "none")) if settings.medium in ESTIMATED_FROM_PHOTOS else psf_argument(settings)
    blur = ["--psf", psf, "--blur-space", settings.blur_space]
    if _view is not None:
        _view.forget()
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
    view = _view = ExactView(worker, folder)
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
    if _view is not None:
        if not _view.ended:
            _view.stop()
            _view.ended = True
        _view.forget()
    _view = None


def camera_in(twin: Any, scene: Any) -> Camera:
    """The scene's camera as the engine sees it among the twin's own Gaussians."""
    thing, render = scene.camera, scene.render
    relative = np.array(twin.matrix_world.inverted() @ thing.matrix_world, dtype=np.float64)
    relative[:3, :3] /= np.linalg.norm(relative[:3, :3], axis=0)  # a scaled twin leaves the camera its axes
    settings = replace(read_settings(thing, render), matrix_world=matrix_to_blender(relative))
    return camera_to_engine(settings, *render_size(render), _NAME)
