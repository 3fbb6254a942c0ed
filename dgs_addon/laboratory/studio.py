"""Builds the scene when its first frame is needed: a finished set needs no Blender."""

from __future__ import annotations

import hashlib
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import DgsError, FormatError
from . import rail
from .scenes import SCENES
from .settings import SynthesizeSettings

#: Radius (m) of the sphere around the ball, for which the paths were laid out.
BALL_RADIUS = 0.17


class Studio:
    """The scene that the settings ask for, in Blender's current file."""

    def __init__(self, settings: SynthesizeSettings) -> None:
        self.settings = settings
        self.ready = False
        self._own: list[Camera] = []
        #: [3] middle of the object in Blender's world, once `cameras` was called.
        self.target: NDArray[np.float64] = rail.TARGET

    def cameras(self) -> list[Camera]:
        """One per view; the scene has to be opened for them only if it is somebody's own.

        Raises:
            DgsError: no bpy, or a scene without a camera.
            FormatError: the scene cannot be read.
        """
        settings = self.settings
        if settings.scene in SCENES and not settings.mesh:
            built = SCENES[settings.scene]
            self.target = np.array(built.middle)
            return rail.cameras(
                settings.path, settings.views, settings.width, settings.height, self.target, built.size, built.ground
            )
        if not settings.from_blend:
            return rail.cameras(settings.path, settings.views, settings.width, settings.height)
        self.enter()
        from . import own_scene  # late: needs bpy

        middle, radius = own_scene.extent()
        self.target = middle
        if settings.path == "scene":
            return self._own
        return rail.cameras(
            settings.path, settings.views, settings.width, settings.height, middle, radius / BALL_RADIUS
        )

    def enter(self) -> Any:
        """The module `render`, with the scene built and ready."""
        if find_spec("bpy") is None:
            raise DgsError(
                "This Python has no Blender in it (no module bpy)",
                "Run `blender -b -P run_dgs.py -- synthesize ...`, or `make setup`, which installs bpy",
            )
        from . import render  # late: needs bpy

        if not self.ready:
            self._build()
            if self.settings.denoise and not render.can_denoise():
                raise DgsError("This build of Blender has no OpenImageDenoise", "Add --no-denoise and more --samples")
            render.prepare(self.settings.samples, self.settings.denoise, alone=self.settings.alone)
            self.ready = True
        return render

    def _build(self) -> None:
        from . import ball, mesh, own_scene  # late: needs bpy

        settings = self.settings
        if settings.mesh:
            mesh.build(Path(settings.mesh), settings.seed, settings.alone)
        elif settings.scene in SCENES:
            import_module(f"{__package__}.scenes.{settings.scene}").build(settings.seed)
        elif settings.from_blend:
            own_scene.build(Path(settings.scene))
            if settings.path == "scene":
                names = rail.names(settings.views)
                self._own = own_scene.own_cameras(settings.views, settings.width, settings.height, names)
            own_scene.enter_camera()
        else:
            ball.build(settings.seed, settings.width, settings.alone)


def source_digest(settings: SynthesizeSettings) -> str:
    """Identifies the content of the mesh or .blend; '' for the ball.

    Raises:
        FormatError: the file cannot be read.
    """
    name = settings.mesh or (settings.scene if settings.from_blend else "")
    if not name:
        return ""
    try:
        return hashlib.sha256(Path(name).read_bytes()).hexdigest()[:16]
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise FormatError(f"'{name}' cannot be read: {reason}", "Check the path") from error
