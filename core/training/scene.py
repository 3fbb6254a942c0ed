"""What a training works on: the Gaussians as they are, the photos on their grids, and how these see them.

The steps are `trainer`'s; what is learned of each photo beside them, what is asked of all photos, and what is kept of
a run have modules of their own, which take a `TrainedScene`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from .. import compiled
from ..colour import srgb_to_linear
from ..devices import backend_on
from ..forward import Exposed, Exposure, ForwardModel, low_pass_on_grid, margin_for
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..imaging.spectrum import NoiseToSignal, noise_to_signal
from ..numbers import number
from ..rasterizer import RasterSettings
from ..views import SparsePoints, View
from .behind import background_of, colour_behind, without_empty
from .cameras.adjusting import Adjust
from .density.control import DensityControl
from .density.footprint import widened
from .density.initial import first_gaussians
from .density.overlap import photos_of_one_side
from .grid import GRID, GridView, grid_step
from .kept_photos import KeptPhotos, OnDevice
from .learned import LearnedEffects
from .level import Level, round_variance
from .loss.contrast import scene_contrast
from .loss.objective import Objective
from .loss.through_glass import GlassObjective, behind_glass
from .optics.focus import SETTINGS as FOCUS
from .optics.kernels import SETTINGS as KERNELS
from .optimizer import Adam
from .paths.settings import SETTINGS as PATHS
from .ranks import ALONE
from .scale import SceneScale, scene_scale
from .settings import TrainingSettings, smoothed_for, smoothness, start_share, trust


@dataclass(frozen=True)
class SceneSettings:
    """How many photos are asked where all would take too long."""

    spectrum_views: int = number(
        12, "photos", "whose spectra and contrasts are averaged, evenly over the set; more say little new"
    )
    watched_views: int = number(
        4,
        "photos",
        "of those held out that are rendered at every evaluation; more cost time that iterations could have",
    )


SCENE = SceneSettings()


class TrainedScene:
    """The Gaussians of a run, the photos, and the way from the ones to the others.

    Args:
        views: photos to fit; heldout: photos to watch only.
        points: what structure from motion found.
        formation: effects besides the point spread; those before the blur are simulated in every step, with depths in
            the scene's unit. Those of the sensor are to be undone on the photos beforehand; exposures are learned from
            there on.
        start: Gaussians to begin with, world units; None for new ones on the points' depth.

    Attributes:
        ranks: processes that train together (`Trainer.join`); each renders photos of its own in a step.
        adjust: which cameras may be moved where paths are learned (`cameras.moving`).
        restore: whether shaken photos may be restored on the way (`restored.start`).
        restored_around: the twin that they are restored around while new Gaussians are fitted to them.
        levels: the photos' grids, the coarsest first; learned: what is learned of each photo.
        step: how many were taken.
        asked: how often all photos were asked, what went since none needed it or as a veil, how often cameras were
            adjusted, whether a random part of the Gaussians is left out, and whether cameras that were given were
            contradicted (2) or not (1).
        repairs, culled: what was repaired, and what the projection left out, by name.

    Raises:
        CameraError: no point lies in front of a camera.
    """

    def __init__(
        self,
        views: Sequence[View],
        heldout: Sequence[View],
        points: SparsePoints,
        medium: Medium,
        settings: TrainingSettings,
        formation: Formation = Formation(),
        start: Gaussians | None = None,
    ) -> None:
        self.ranks = ALONE
        self.adjust: Adjust = "never"
        self.restore = False
        self.restored_around: Gaussians | None = None
        self.together = photos_of_one_side(views, points)  # they average noise; copies average none
        self.scale: SceneScale = scene_scale([v.camera for v in views], points)
        settings = self._settings_for(settings, medium, formation, views)
        self.settings, self.medium, self.begun = settings, medium, formation
        name = "cpu" if settings.device == "auto" else settings.device
        backend_on(name).check()  # (before torch, whose message names devices of its own)
        self.device = torch.device(name)
        self.views, self.heldout, self.points = views, heldout, points
        width, height = views[0].camera.width, views[0].camera.height
        step = settings.grid_step or grid_step(medium, width, height)
        cameras = {view.name: self.scale.camera_to_unit(view.camera) for view in (*views, *heldout)}
        names = [view.name for view in views]
        self.learned = LearnedEffects(formation, self.scale, cameras, names, 2 * step, settings.seed)
        self.formation = self.learned.formation
        fine = self._level(step)
        self.levels = [fine]
        if settings.coarse_share > 0 and min(width, height) // (2 * step) >= GRID.smallest_side:
            self.levels = [self._level(2 * step), fine]
        gaussians = self._first(fine) if start is None else self.scale.to_unit(start)
        self.optimizer = Adam(gaussians.to(self.device))
        self.density = DensityControl(len(gaussians), self.device)
        placed = np.stack([-c.rotation.T @ c.translation for c in (cameras[name] for name in names)])
        self.centres = torch.from_numpy(placed.astype(np.float32)).to(self.device)
        self._kept: tuple[Level, KeptPhotos] | None = None
        self.known_background = background_of(views)
        self.background = colour_behind(views)
        self.transparent = any(view.alpha is not None for view in views)
        self.step = 0
        self.repairs: dict[str, int] = {}
        self.culled: dict[str, int] = {}
        self.asked = {"photos": 0, "unneeded": 0, "adjusted": 0, "dropout": 0, "given": 0}
        self.origin: dict[str, Any] | None = None

    def _first(self, level: Level) -> Gaussians:
        """New Gaussians on the points' depth."""
        return self.new_gaussians(level, lambda i: without_empty(level.views[i].planes(), self.views[i], level.step))

    def new_gaussians(self, level: Level, planes: Callable[[int], NDArray[np.float32]]) -> Gaussians:
        """Gaussians on the points' depth, coloured as planes [3, H, W] of photo i on the level's grid; NaN for none."""
        settings = self.settings
        return first_gaussians(
            [view.camera for view in level.views],
            planes,
            self.scale.sparse_to_unit(self.points),
            settings.max_gaussians,
            settings.sh_degree,
            np.random.default_rng([settings.seed, 0]),
            margin=level.margin,
        )

    def _settings_for(
        self, settings: TrainingSettings, medium: Medium, formation: Formation, views: Sequence[View]
    ) -> TrainingSettings:
        """The settings as these photos, their blur and what is learned of them ask for."""
        sigma = max(settings.deconvolved_sigma, medium.mean_sigma([view.name for view in views]))
        if formation.glass is not None:
            camera = views[0].camera
            sigma = formation.glass.sigma(self.scale.size, math.hypot(camera.width, camera.height))
        settings = smoothed_for(settings, sigma, self.together)
        moved = formation.motion is not None and any(view.name in formation.motion.names for view in views)
        learned = (moved or None, PATHS), (formation.focus, FOCUS), (formation.kernels, KERNELS)
        coarse = [numbers.coarse_share for effect, numbers in learned if effect is not None]
        return replace(
            settings,
            variation_weight=settings.variation_weight * smoothness(self.together),
            speck_weight=settings.speck_weight * smoothness(self.together),
            start_share=settings.start_share * start_share(self.together),
            coarse_share=max([settings.coarse_share, *coarse]),
        )

    def on_grid(self, views: Sequence[View], step: int) -> list[GridView]:
        """Photos, each with its camera in the scene's unit, on a grid of `step` photo px."""
        unit, medium = self.scale.camera_to_unit, self.medium

        def on_grid(view: View) -> GridView:
            return GridView(view, unit(view.camera), step, medium.psf_for(view.name), medium.blur_space)

        largest = max((view.camera.width * view.camera.height for view in views), default=0)
        with ThreadPoolExecutor(compiled.photos_at_once(largest)) as pool:
            return list(pool.map(on_grid, views))

    def _level(self, step: int) -> Level:
        views, heldout = self.on_grid(self.views, step), self.on_grid(self.heldout[: SCENE.watched_views], step)
        sigma = max((float(np.linalg.eigvalsh(v.psf.covariance)[-1]) ** 0.5 for v in views if v.psf), default=0.0)
        contrast = scene_contrast(self._some_through_their_blur(views))
        reach = math.hypot(sigma, self.formation.reach(views[0].camera.width, views[0].camera.height))
        return Level(step, views, heldout, margin_for(reach), self._ratio(views, step), contrast)

    def _ratio(self, views: list[GridView], step: int) -> NoiseToSignal | None:
        """Noise over signal of the photos on a grid, as far as they are trusted.

        Behind glass they are trusted least, however many: the width of the blur follows from the twin's own depth, and
        what is wrong with it is in all photos alike.
        """
        glass = self.formation.glass
        if (glass is None and all(v.psf is None for v in views)) or self.settings.loss == "paper":
            return None
        measured = self._some_through_their_blur(views)
        photos = [v.planes() for v in measured]
        if self.medium.blur_space == "linear" or glass is not None:
            photos = [np.asarray(srgb_to_linear(p), np.float32) for p in photos]
        gain = self.settings.noise_gain or trust(self.together if glass is None else 0)
        return noise_to_signal(photos, [v.psf for v in measured], self.views[0].rounding / step).trusted(gain)

    def _some_through_their_blur(self, views: list[GridView]) -> list[GridView]:
        """Photos that say what all are like, each with its point spread: behind glass that at the unit of depth."""
        some, glass = views[:: max(1, len(views) // SCENE.spectrum_views)], self.formation.glass
        return some if glass is None else [v.blurred_by(behind_glass(glass, v.name, v.camera)) for v in some]

    def objective(self, level: Level, view: Exposure) -> Objective:
        """The objective for a view's size and point spread; made once for all views that share them."""
        key = (view.camera.height, view.camera.width, view.psf)
        if key not in level.objectives:
            level.objectives[key] = Objective(
                view.psf,
                Frame(view.camera.height, view.camera.width, level.margin),
                self.medium.blur_space,
                self.settings,
                self.device,
                level.ratio,
                level.contrast,
            )
        return level.objectives[key]

    def through_glass(self, level: Level, view: Exposure) -> GlassObjective | None:
        """The objective for a view's size behind glass; None where there is none, or the loss inverts nothing."""
        glass = self.formation.glass
        if glass is None or level.ratio is None or self.formation.motion is not None:
            return None
        size = view.camera.height, view.camera.width
        if size not in level.behind_glass:
            widest = glass.reach(math.hypot(*size))
            level.behind_glass[size] = GlassObjective(
                Frame(*size, level.margin), self.settings, level.ratio, level.contrast, widest, self.device
            )
        return level.behind_glass[size]

    def raster_settings(self, level: Level) -> RasterSettings:
        """The low-pass is the same footprint on the photo whatever the grid."""
        low_pass = low_pass_on_grid(level.step, self.settings.low_pass)
        if self.settings.blur_evaluation == "splats":
            low_pass += round_variance(level.views)
        return RasterSettings(low_pass=low_pass, depth=self.formation.by_depth)

    def model(self, level: Level) -> ForwardModel:
        """From the Gaussians to the photos on a level's grid."""
        return ForwardModel(
            self.raster_settings(level), lambda view: self.objective(level, view).medium, level.margin, self.formation
        )

    def exposed(self, level: Level, view: GridView, behind: torch.Tensor | None = None) -> Exposed:
        """What the twin, as it is, would show in a photo, before [3] sRGB; without gradient."""
        behind = self.background if behind is None else behind
        with torch.no_grad():
            return self.model(level).expose(self.optimizer.gaussians, view, behind)

    def photo_on_device(self, level: Level, view: GridView, backdrop: torch.Tensor) -> OnDevice:
        """A photo on the device; those of one level stay there, as far as there is room."""
        if self._kept is None or self._kept[0] is not level:
            self._kept = level, KeptPhotos(self.device)
        red, green, blue = backdrop.tolist()
        return self._kept[1].of(view, (red, green, blue))

    def counting(self, view: GridView) -> torch.Tensor | None:
        """[H, W] bool: the px of a photo that count, on the device; None for all of them."""
        return None if view.valid is None else torch.from_numpy(view.valid).to(self.device)

    @property
    def cameras_moved(self) -> bool:
        """Whether cameras were adjusted so far."""
        return self.asked["adjusted"] > 0

    def result(self) -> Gaussians:
        """The twin so far: in the world of the cameras, as the usual viewers draw it."""
        world = self.scale.to_world(self.optimizer.gaussians)
        finite = torch.isfinite(torch.cat([t.reshape(len(world), -1) for _, t in world.named()], dim=1)).all(dim=1)
        if not bool(finite.all()):
            self.repairs["left out of the twin, non-finite"] = int((~finite).sum())
            world = Gaussians(**{name: t[finite] for name, t in world.named()})
        return widened(world, [v.camera for v in self.views], self.settings.low_pass)
