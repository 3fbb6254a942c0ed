"""What is learned of the photos together with the Gaussians: exposures, the camera's path in each, and their focus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..errors import CheckpointError
from ..forward import Exposed
from ..imaging.formation.chain import Formation
from ..imaging.formation.exposure import Exposure
from ..imaging.formation.focus import FocusBlur
from .grid import GridView
from .optics.exposures import SETTINGS as EXPOSURES
from .optics.exposures import Asked, LearnedExposures
from .optics.focus import LearnedFocus
from .optics.glass import LearnedGlass
from .optics.kernels import LearnedKernels
from .paths.camera_paths import CameraPaths
from .scale import SceneScale


class LearnedEffects:
    """Parameters of a chain of effects that a training learns.

    Args:
        start: the chain in the cameras' world, where learning begins.
        scale: of the scene; cameras: of all photos by name, on their own grid, in the scene's unit.
        fitted: names of the photos that are trained on.
        step: photo px per px of the coarsest grid.

    Attributes:
        exposures, paths, focus, kernels, glass: None where none are learned.
        formation: the chain that the forward model goes along; it sees every step of what changes frames and light
            before the sensor. Exposures are undone on the photos instead.
    """

    def __init__(
        self,
        start: Formation,
        scale: SceneScale,
        cameras: Mapping[str, Camera],
        fitted: Sequence[str],
        step: int,
        seed: int,
    ) -> None:
        start, self._scale = start.scaled(1.0 / scale.size), scale
        exposure = next((effect for effect in start.effects if isinstance(effect, Exposure)), None)
        self.exposures = None if exposure is None or not exposure.names else LearnedExposures(exposure)
        moved = start.motion
        self.paths = None if moved is None else CameraPaths(moved, cameras, fitted, step, seed, alone=not start.light)
        self.formation = start
        if self.paths is not None:
            self.formation = Formation([self.paths.motion if e is moved else e for e in start.effects])
        spread = next((effect for effect in start.effects if isinstance(effect, FocusBlur)), None)
        self.focus = None if spread is None else LearnedFocus(spread, fitted)
        if self.focus is not None:
            effects = self.formation.effects
            self.formation = Formation([self.focus.effect if e is spread else e for e in effects])
        free = self.formation.kernels
        self.kernels = None if free is None else LearnedKernels(free)
        if self.kernels is not None:
            self.formation = Formation([self.kernels.effect if e is free else e for e in self.formation.effects])
        sheet = self.formation.glass
        self.glass = None if sheet is None or not sheet.learned else LearnedGlass(sheet)

    def asked(self, view: GridView, exposed: Exposed, photo: Tensor, share: float) -> Asked | None:
        """The photo without its exposure, from which that is learned; None where none is.

        Args:
            photo: [3, H, W] sRGB on the grid; share: of the run, in [0, 1].
        """
        if self.exposures is None:
            return None
        shown = exposed.degraded
        present = view.present()
        opaque = None if present is None else torch.from_numpy(present).to(photo.device)
        if share >= EXPOSURES.begin:
            counts = None if view.valid is None else torch.from_numpy(view.valid).to(photo.device)
            if opaque is not None:  # what is behind the object has no exposure
                shows = opaque > EXPOSURES.opaque
                counts = shows if counts is None else counts & shows
            self.exposures.learn(view.name, photo, shown, counts)
        asked = self.exposures.asked(view.name, photo, shown)
        if asked is None or opaque is None:
            return asked
        return Asked(photo + opaque * (asked.photo - photo), asked.weight)

    @property
    def anything(self) -> bool:
        """Whether anything is learned."""
        return any(part is not None for part in (self.exposures, self.paths, self.focus, self.kernels, self.glass))

    @property
    def unseen_visits(self) -> int:
        """Steps for a photo that is held out, on the finished twin; 0 where nothing of it is learned."""
        learned = (part.settings.unseen_visits for part in (self.paths, self.focus, self.kernels) if part is not None)
        return max(learned, default=0)

    def chain(self) -> Formation:
        """The chain with what was learned of it, in the cameras' world."""
        learned = {} if self.exposures is None else {Exposure.name: self.exposures.exposure()}
        chain = Formation([learned.get(effect.name, effect) for effect in self.formation.effects])
        return chain.scaled(self._scale.size)

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        exposures = {} if self.exposures is None else self.exposures.state()
        paths = {} if self.paths is None else self.paths.state()
        glass = {} if self.glass is None else self.glass.state()
        kernels = {} if self.kernels is None else self.kernels.state()
        return {**exposures, **paths, **glass, **kernels, **({} if self.focus is None else self.focus.state())}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`.

        Raises:
            CheckpointError: it is not of these photos.
        """
        kinds = (
            ("exposures", self.exposures),
            ("camera paths", self.paths),
            ("focus", self.focus),
            ("kernels", self.kernels),
            ("glass", self.glass),
        )
        for what, learned in kinds:
            if learned is not None and not learned.restore(arrays):
                raise CheckpointError(
                    f"The checkpoint does not hold the {what} of these photos", "Start again without --resume"
                )
