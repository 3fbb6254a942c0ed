"""The optimization, step by step: render one photo's view, ask the objective, follow the gradient."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, SupportsFloat

import numpy as np
import torch

from .. import compiled
from ..camera import Camera
from ..colour import srgb_to_linear
from ..constants import SH_COEFFICIENTS
from ..devices import backend_on
from ..errors import TrainingError
from ..evaluation.halves import exposed_by_halves
from ..forward import Exposed, Exposure, ForwardModel, SubFrame, low_pass_on_grid, margin_for, sharp_view
from ..forward.compare import mean_square, psnr_of
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.formation.chain import Formation
from ..imaging.formation.effect import Shot
from ..imaging.formation.focus import OUT_OF_FOCUS
from ..imaging.medium import Medium
from ..imaging.spectrum import NoiseToSignal, noise_to_signal
from ..numbers import number
from ..rasterizer import RasterSettings
from ..views import SparsePoints, View
from .behind import background_of, colour_behind, without_empty
from .cameras.adjusting import SETTINGS as ADJUSTING
from .cameras.adjusting import Adjust, adjusted_cameras, contradicted, placed_camera
from .cameras.adjusting import due as due_adjustments
from .cameras.twin_tracks import LaidBeside, Sighting, carried, sighted
from .checkpoint import Checkpoint
from .density.contribution import SeenByPhotos, due, needed, photos_asked, seen_by
from .density.control import DensityControl
from .density.dropout import DROPOUT, getting_worse, learned_by_heart, left_out
from .density.finest import hold_sizes, narrowest_blur
from .density.footprint import widened
from .density.initial import first_gaussians
from .density.overlap import photos_of_one_side
from .density.veils import veils
from .grid import GRID, GridView, grid_step
from .guards import GUARDS, drop_non_finite
from .kept_photos import KeptPhotos, OnDevice
from .learned import LearnedEffects
from .level import Level, round_variance
from .loss.contrast import scene_contrast
from .loss.objective import Objective
from .loss.through_glass import GlassObjective, behind_glass
from .optics.focus import SETTINGS as FOCUS
from .optics.focus import BlurByDepth, Seen
from .optics.kernels import SETTINGS as KERNELS
from .optimizer import Adam
from .origin import origin
from .paths.camera_paths import SETTINGS as PATHS
from .ranks import ALONE, RankLost, Ranks
from .scale import SceneScale, scene_scale
from .schedule import harmonics_degree
from .settings import TrainingSettings, calm_end, rates_of_long_runs, smoothed_for, smoothness, start_share, trust


@dataclass(frozen=True)
class TrainerSettings:
    """How many photos are asked where all would take too long."""

    spectrum_views: int = number(
        12, "photos", "whose spectra and contrasts are averaged, evenly over the set; more say little new"
    )
    watched_views: int = number(
        4,
        "photos",
        "of those held out that are rendered at every evaluation; more cost time that iterations could have",
    )


TRAINER = TrainerSettings()


#: What the projection culls because it has to; what is merely not seen (outside, transparent) is no repair.
_CULLED = {
    "non_finite": "non-finite parameters (Gaussian-views)",
    "degenerate": "without a shape, too bright or too far (Gaussian-views)",
    "behind": "behind the camera (Gaussian-views)",
}
#: What photos said of cameras that were given.
_BELIEVED, _CONTRADICTED = 1, 2


class Trainer:
    """One run of the optimization.

    Args:
        views: photos to fit; heldout: photos to watch only.
        points: what structure from motion found.
        formation: effects besides the point spread; those before the blur are simulated in every step, with depths in
            the scene's unit. Those of the sensor are to be undone on the photos beforehand; exposures are learned from
            there on.
        start: Gaussians to begin with, world units; None for new ones on the points' depth.

    Attributes:
        ranks: processes that train together (`join`); each renders photos of its own in a step.
        adjust: which cameras may be moved where paths are learned (`adjust_cameras`).

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
        self.together = photos_of_one_side(views, points)  # they average noise; copies average none
        self.scale: SceneScale = scene_scale([v.camera for v in views], points)
        settings = self._settings_for(settings, medium, formation, views)
        self.settings, self.medium, self._begun = settings, medium, formation
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
        gaussians = (
            self.scale.to_unit(start)
            if start is not None
            else first_gaussians(
                [v.camera for v in fine.views],
                lambda i: without_empty(fine.views[i].planes(), views[i], step),
                self.scale.sparse_to_unit(points),
                settings.max_gaussians,
                settings.sh_degree,
                np.random.default_rng([settings.seed, 0]),
                margin=fine.margin,
            )
        )
        self.optimizer = Adam(gaussians.to(self.device))
        self.density = DensityControl(len(gaussians), self.device)
        placed = np.stack([-c.rotation.T @ c.translation for c in (cameras[name] for name in names)])
        self._centres = torch.from_numpy(placed.astype(np.float32)).to(self.device)
        self._kept: tuple[Level, KeptPhotos] | None = None
        self._known = background_of(views)
        self.background = colour_behind(views)
        self.transparent = any(view.alpha is not None for view in views)
        self.step = 0
        self.repairs: dict[str, int] = {}
        self.culled: dict[str, int] = {}
        # how often all photos were asked, what went since none needed it or as a veil, how often cameras were adjusted,
        # and whether cameras that were given were contradicted (2) or not (1)
        self.asked = {"photos": 0, "unneeded": 0, "adjusted": 0, "dropout": 0, "given": 0}
        self._origin: dict[str, Any] | None = None

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

    def join(self, ranks: Ranks) -> None:
        """Trains together with other processes from now on, from rank 0's Gaussians.

        Raises:
            TrainingError: several ranks cannot train this. RankLost: another one died.
        """
        if not ranks.alone and self.learned.anything:
            raise TrainingError(
                "What is learned of each photo (exposure, motion, focus, kernel, glass) is learned by one process",
                "Use --effects none, or start one rank",
            )
        if not ranks.alone and self.device.type != "cpu":
            raise TrainingError("Several ranks train on processors only", "Use --device cpu")
        self.ranks = ranks
        self.follow_first()

    def _on_grid(self, views: Sequence[View], step: int) -> list[GridView]:
        unit, medium = self.scale.camera_to_unit, self.medium

        def on_grid(view: View) -> GridView:
            return GridView(view, unit(view.camera), step, medium.psf_for(view.name), medium.blur_space)

        largest = max((view.camera.width * view.camera.height for view in views), default=0)
        with ThreadPoolExecutor(compiled.photos_at_once(largest)) as pool:
            return list(pool.map(on_grid, views))

    def _level(self, step: int) -> Level:
        views, heldout = self._on_grid(self.views, step), self._on_grid(self.heldout[: TRAINER.watched_views], step)
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
        some, glass = views[:: max(1, len(views) // TRAINER.spectrum_views)], self.formation.glass
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

    def _ask_through_glass(
        self,
        through: GlassObjective,
        exposed: Exposed,
        photo: torch.Tensor,
        valid: torch.Tensor | None,
        share: float,
        weight: torch.Tensor | None,
    ) -> SupportsFloat:
        """Follows the photo in the degraded frame and, inverted, in the sharp one; the loss."""
        glass = self.formation.glass
        assert glass is not None
        evaluate = through.start_loss if share < self.settings.start_share else through.loss
        found = evaluate(exposed, glass, photo, valid)
        in_reached, in_sharp = found.in_reached, found.in_sharp
        if weight is not None:
            in_reached, in_sharp = in_reached * weight, in_sharp * weight
        exposed.backward(in_reached, in_sharp)
        return found.loss

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

    def rates(self, share: float) -> dict[str, float]:
        """Step sizes at a share of the run."""
        r, share = self.settings.rates, min(share, 1.0)
        means = r.means * (r.means_end / r.means) ** share
        calmer = rates_of_long_runs(self.settings.steps) * calm_end(share)
        return {name: calmer * rate for name, rate in {**asdict(r), "means": means}.items()}

    def view_at(self, level: Level, step: int) -> GridView:
        """Every photo once per round, in an order that depends on seed and round only."""
        n = len(level.views)
        return level.views[_order(self.settings.seed, step // n, n)[step % n]]

    def _shown(self, share: float) -> Gaussians:
        """The Gaussians of a step, with as many harmonics as the run has come to; gradients flow to the optimizer's."""
        gaussians, highest = self.optimizer.gaussians, self.settings.sh_degree
        degree = harmonics_degree(share, highest)
        if degree != highest:
            gaussians = replace(gaussians, sh=gaussians.sh[:, : SH_COEFFICIENTS[degree]])
        if not self.asked["dropout"]:
            return gaussians
        more = left_out(len(gaussians), share, np.random.default_rng([self.settings.seed, 6, self.step]))
        return replace(gaussians, opacity_logits=gaussians.opacity_logits + more.to(self.device))

    def backdrop(self) -> torch.Tensor:
        """[3] the colour behind the twin in this step: the photos' mean, shaken.

        A fixed colour would be taken for part of the scene, which then stays translucent. Behind transparent photos it
        is any colour: the same is put behind the photo, and only Gaussians of the photo's alpha explain all of them.
        A plain background that opaque photos show is what it is.
        """
        if self.transparent:
            any_colour = np.random.default_rng([self.settings.seed, 3, self.step]).uniform(0, 1, 3)
            return torch.from_numpy(any_colour).to(self.background)
        if self._known is not None:
            return self.background
        shake = self.settings.backdrop * np.random.default_rng([self.settings.seed, 3, self.step]).uniform(-1, 1, 3)
        return self.background + torch.from_numpy(shake).to(self.background)

    def advance(self, share: float) -> SupportsFloat:
        """One iteration at a share in [0, 1) of the run; returns the photo's loss (to read it may wait for a card)."""
        s = self.settings
        level = self.levels[0] if share < s.coarse_share else self.levels[-1]
        view = self.view_at(level, self.step + self.ranks.rank)
        self._find_focus(level, share)
        backdrop = self.backdrop()
        exposed = self.model(level).expose(self._shown(share), view, backdrop)
        compared = self._photo(level, view, backdrop)
        photo, valid = compared.planes, compared.valid
        objective = self.objective(level, view)
        asked = self.learned.asked(view, exposed, photo, share)
        wanted = photo if asked is None else asked.photo
        weight = None if asked is None else asked.weight
        take = self._ask_path(level, view, exposed, wanted, backdrop)
        through = self.through_glass(level, view)
        if through is not None:
            loss = self._ask_through_glass(through, exposed, wanted, valid, share, weight)
        else:
            sharpened = objective.inverse is not None and share < s.start_share
            found = (objective.start_loss if sharpened else objective.loss)(exposed.reached, wanted, valid)
            exposed.backward(found.gradient if weight is None else found.gradient * weight)
            loss = found.loss
        self._collect(exposed)
        take()
        self._follow_focus(view, exposed, wanted)
        if share >= KERNELS.begin:
            self._follow_kernel(view, exposed, wanted)
        if self.learned.glass is not None:
            self.learned.glass.learn(view.name, exposed, wanted, valid, share)
        self.optimizer.step(self.rates(share), self.ranks.count)
        self.step += self.ranks.count
        if self._passed(GUARDS.every):
            self._guard()
        if self._passed(max(GUARDS.every, len(self.views))):  # (every photo is asked: of many, less often)
            self._hold_sizes()
        if self._passed(s.density_every) and share < s.density_until:
            self.density.act(self.optimizer, s.max_gaussians, np.random.default_rng([s.seed, 2, self.step]))
            self.follow_first()
        return loss

    def _guard(self) -> None:
        """Checks all parameters; counts what was repaired."""
        found = backend_on(self.device).guard(self.optimizer.gaussians, self._centres)
        for name, count in (("limited sizes", found.limited), ("clamped scales", found.clamped)):
            most = f"{name}, most at once"
            self.repairs[most] = max(self.repairs.get(most, 0), count)
        if not found.broken:
            return
        for name, count in drop_non_finite(self.optimizer, self.step).items():
            self.repairs[f"dropped, non-finite {name}"] = self.repairs.get(f"dropped, non-finite {name}", 0) + count
            self.density = DensityControl(len(self.optimizer.gaussians), self.device)

    def _photo(self, level: Level, view: GridView, backdrop: torch.Tensor) -> OnDevice:
        """A photo on the device; those of one level stay there, as far as there is room."""
        if self._kept is None or self._kept[0] is not level:
            self._kept = level, KeptPhotos(self.device)
        red, green, blue = backdrop.tolist()
        return self._kept[1].of(view, (red, green, blue))

    def _hold_sizes(self) -> None:
        """Nothing is finer than the photo that has it most in focus shows (`training.density.finest`)."""
        focus = self.learned.focus
        if focus is not None and focus.begun:
            gaussians, level = self.optimizer.gaussians, self.levels[-1]
            narrowest = narrowest_blur(gaussians.means, level.views, focus.effect)
            hold_sizes(gaussians, narrowest.size)
            self.repairs[OUT_OF_FOCUS] = narrowest.out_of_focus(level.step)

    def _passed(self, every: int) -> bool:
        """Whether the last step came to a multiple of `every`, or went beyond it."""
        return self.step // every > (self.step - self.ranks.count) // every

    def _collect(self, exposed: Exposed) -> None:
        """What a step's renders showed of the Gaussians; gradients become the mean of all ranks' photos."""
        density = self.density
        before = density.gradients, density.views
        if not self.ranks.alone:
            density.gradients, density.views = (torch.zeros_like(tensor) for tensor in before)
        for screen in exposed.screens:
            density.collect(screen)
            for reason, count in screen.culled.items():
                self.culled[reason] = self.culled.get(reason, 0) + count
        if self.ranks.alone:
            return
        gradients = [tensor.grad for _, tensor in self.optimizer.gaussians.named() if tensor.grad is not None]
        try:
            self.ranks.add([*gradients, density.gradients, density.views])
        except RankLost:
            density.gradients, density.views = before  # as it was before this step, for the checkpoint
            raise
        for gradient in gradients:
            gradient /= self.ranks.count
        density.gradients, density.views = density.gradients + before[0], density.views + before[1]

    def follow_first(self) -> None:
        """Goes on with rank 0's Gaussians: where processors differ, so do last digits, and they add up."""
        if self.ranks.alone:
            return
        arrays = {name: array for name, array in self._arrays().items() if array.dtype == np.float32}
        self._take(self.ranks.arrays_of_first(arrays))

    def _ask_path(
        self, level: Level, view: GridView, exposed: Exposed, photo: torch.Tensor, behind: torch.Tensor
    ) -> Callable[[], None]:
        """What a photo says of its path, asked beside the backward pass; what is returned takes the step.

        A photo whose path is compared with others, or whose light passes more than the path, is asked when that is
        called: effects keep what they computed.
        """
        paths, alone = self.learned.paths, lambda: self._follow_path(level, view, exposed, photo, behind)
        if paths is None:
            return alone
        plain = view.psf is None and exposed.together is None
        apart = plain and self.device.type == "cpu" and compiled.threads() > 1
        if not apart or paths.looks_again(view.name):
            return alone
        asking = _beside().submit(self._asked_path, level, view, exposed, photo, behind)
        return lambda: asking.result()()

    def _asked_path(
        self, level: Level, view: GridView, exposed: Exposed, photo: torch.Tensor, behind: torch.Tensor
    ) -> Callable[[], None]:
        paths = self.learned.paths
        assert paths is not None
        if paths.wants_depth(view.name, view.camera):
            self._still(level, view, behind)
        counts = None if view.valid is None else torch.from_numpy(view.valid).to(self.device)
        return paths.ask(view.name, view.camera, exposed, photo, counts)

    def _follow_path(
        self, level: Level, view: GridView, exposed: Exposed, photo: torch.Tensor, behind: torch.Tensor
    ) -> None:
        """Learns a step of the path that the camera took in a photo; `behind`: [3] sRGB."""
        paths = self.learned.paths
        if paths is None:
            return
        again = paths.looks_again(view.name)
        if again or paths.wants_depth(view.name, view.camera):
            still = self._still(level, view, behind)
        counts = None if view.valid is None else torch.from_numpy(view.valid).to(self.device)
        if again:
            expose = lambda: self.exposed(level, view, behind)  # noqa: E731
            paths.look_again(view.name, view.camera, photo, still, expose, counts)
        paths.learn(view.name, view.camera, exposed, photo, counts)

    def _still(self, level: Level, view: GridView, behind: torch.Tensor) -> torch.Tensor:
        """[3, H, W] sRGB as the twin shows a photo without motion; its path goes by the depth there from now on."""
        assert self.learned.paths is not None
        settings = replace(self.raster_settings(level), depth=True)
        with torch.no_grad():
            still = sharp_view(self.optimizer.gaussians, view.camera, settings, behind)
        assert still.mean_depth is not None
        self.learned.paths.see_depth(view.name, still.mean_depth)
        return still.image

    def _follow_focus(self, view: GridView, exposed: Exposed, photo: torch.Tensor) -> None:
        """Learns a step of a photo's focus."""
        if self.learned.focus is not None:
            counts = None if view.valid is None else torch.from_numpy(view.valid).to(self.device)
            self.learned.focus.learn(view.name, exposed, photo, counts)

    def _follow_kernel(self, view: GridView, exposed: Exposed, photo: torch.Tensor) -> None:
        """Learns a step of a photo's kernel."""
        if self.learned.kernels is not None:
            counts = None if view.valid is None else torch.from_numpy(view.valid).to(self.device)
            self.learned.kernels.learn(view.name, exposed, photo, counts)

    def _find_focus(self, level: Level, share: float) -> None:
        """Compares all photos with the twin where a share of the run makes it due; see `training.optics.focus`."""
        focus = self.learned.focus
        if focus is None or not focus.due(share):
            return
        tables = {view.name: self._blur_by_depth(level, view) for view in level.views}
        focus.search({name: table for name, table in tables.items() if table is not None}, share)

    def _blur_by_depth(self, level: Level, view: GridView) -> BlurByDepth | None:
        """How a photo differs from the twin's view, blurred evenly."""
        focus, medium = self.learned.focus, self.objective(level, view).medium
        assert focus is not None
        counts = None if view.valid is None else torch.from_numpy(view.valid).to(self.device)
        camera, photo = view.camera, torch.from_numpy(view.planes()).to(self.device)
        with torch.no_grad():
            model, gaussians = self.model(level), self.optimizer.gaussians
            sharp = model.sharp(gaussians, camera, self.background)
            depth = model.surface(gaussians, SubFrame(camera.with_margin(level.margin)), sharp)
            assert depth is not None
            shot = Shot(view.name, camera.height, camera.width, level.margin, (camera.cx, camera.cy))
            return BlurByDepth.of(Seen(sharp, depth, photo, counts, medium, shot), focus.effect, focus.settings)

    def follow_unseen(self, level: Level, view: GridView) -> None:
        """Learns a step of a held-out photo's own path and focus; the Gaussians do not see it."""
        if not self.learned.unseen_visits:
            return
        exposed, photo = self.exposed(level, view), torch.from_numpy(view.planes()).to(self.device)
        self._follow_path(level, view, exposed, photo, self.background)
        self._follow_focus(view, exposed, photo)
        self._follow_kernel(view, exposed, photo)

    def _find_unseen(self, level: Level, view: GridView) -> None:
        """Finds the focus of a photo that is held out from scratch."""
        if self.learned.focus is not None:
            table = self._blur_by_depth(level, view)
            if table is not None:
                self.learned.focus.search_unseen(view.name, table)

    def finish_unseen(self) -> None:
        """Finds the paths and foci of all photos that are held out on the Gaussians as they are."""
        visits = self.learned.unseen_visits
        if not visits or not self.heldout:
            return
        level = self.levels[-1]
        for view in self._on_grid(self.heldout, level.step):
            self._find_unseen(level, view)
            for _ in range(visits):
                self.follow_unseen(level, view)
            self._place_unseen(level, view)

    def _place_unseen(self, level: Level, view: GridView) -> None:
        """Places the camera of a photo that is held out before the finished twin, if it was found.

        What the photos showed when cameras were adjusted last is not quite the twin that became of it.
        """
        paths = self.learned.paths
        if paths is not None and self.cameras_moved and view.name in paths.motion.names:
            for _ in range(ADJUSTING.unseen_rounds):
                paths.place(view.camera, placed_camera(sighted(self._laid_beside(level, view))))

    def measure_kernels(self) -> None:
        """Finds how well each photo determines its kernel, on the Gaussians as they are."""
        kernels, level = self.learned.kernels, self.levels[-1]
        if kernels is None:
            return
        for view in [*level.views, *self._on_grid(self.heldout, level.step)]:
            with torch.no_grad():
                exposed, photo = self.exposed(level, view), torch.from_numpy(view.planes()).to(self.device)
                asked = self.learned.asked(view, exposed, photo, 0.0)  # (at the beginning of a run nothing is learned)
                counts = None if view.valid is None else torch.from_numpy(view.valid).to(self.device)
                kernels.measure(view.name, exposed, photo if asked is None else asked.photo, counts)

    def ask_photos(self, share: float) -> None:
        """Asks all photos what they see of each Gaussian, where a share in [0, 1] of the run makes it due, and goes on
        without those that none of them needs, and without veils (`training.density.veils`)."""
        if self.asked["photos"] >= due(share, self.settings.steps, len(self.views)):
            return
        level = self.levels[0]
        # What lies beyond a photo's border is blurred into it, and counts.
        count = photos_asked(self.settings.steps, len(level.views))
        chosen = [level.views[i * len(level.views) // count] for i in range(count)]
        photos = [(view.camera.with_margin(level.margin), self._counting(view, level.margin)) for view in chosen]
        settings = replace(self.raster_settings(level), depth=False)
        wanted = needed(self._seen(photos, settings)) & ~self._veils([view.camera for view in chosen])
        rows = torch.nonzero(wanted)[:, 0]
        before = len(self.optimizer.gaussians)
        if 0 < len(rows) < before:
            self.density.keep(self.optimizer, rows)
            self.asked["unneeded"] += before - len(rows)
        self.asked["photos"] += 1

    @property
    def cameras_moved(self) -> bool:
        """Whether cameras were adjusted so far."""
        return self.asked["adjusted"] > 0

    def _adjusts(self, share: float) -> bool:
        """Whether cameras are to be adjusted at a share of the run."""
        movable = self.adjust != "never" and self.asked["given"] != _BELIEVED
        return movable and self.asked["adjusted"] < due_adjustments(share)

    def adjust_cameras(self, share: float, cancelled: Callable[[], bool] = lambda: False) -> None:
        """Moves all cameras and the surface by what photos show beside the twin, where a share of the run makes it due.

        Only of photos that were shaken: cameras that were found, and given ones that the photos contradict when this
        is due for the first time. Where it is cancelled on the way, it is still due.
        """
        paths = self.learned.paths
        if paths is None or not self._adjusts(share):
            return
        level = self.levels[0] if share < self.settings.coarse_share else self.levels[-1]
        if sum(view.camera.width * view.camera.height for view in level.views) > ADJUSTING.most_px:
            return
        fitted = [view for view in level.views if view.name in paths.motion.names]
        seen = self._beside(level, fitted, cancelled)
        if seen is None or not self._doubted(seen):
            return
        unseen = [view for view in self._on_grid(self.heldout, level.step) if view.name in paths.motion.names]
        for view in unseen:
            for _ in range(ADJUSTING.unseen_visits):
                self.follow_unseen(level, view)
        others = self._beside(level, unseen, cancelled)
        if others is None:
            return
        self.asked["adjusted"] = due_adjustments(share)
        moved = adjusted_cameras(seen, others, [view.camera for view in fitted], self._drawn_tracks())
        if moved is None:
            return
        for view, camera in zip([*fitted, *unseen], moved.cameras, strict=True):
            paths.place(view.camera, camera)
        means = self.optimizer.gaussians.means
        with torch.no_grad():
            places = carried(means.cpu().double().numpy(), moved.before, moved.after)
            means.copy_(torch.from_numpy(places).to(means))

    def _doubted(self, seen: Sequence[Sighting]) -> bool:
        """Whether the cameras may be wrong: found ones always may; of given ones the photos are asked, once."""
        if self.adjust == "contradicted" and not self.asked["given"]:
            self.asked["given"] = _CONTRADICTED if contradicted(seen, self._drawn_tracks()) else _BELIEVED
        return self.asked["given"] != _BELIEVED

    def _drawn_tracks(self) -> np.random.Generator:
        """Which points of the twin are followed through the photos in this step."""
        return np.random.default_rng([self.settings.seed, 5, self.step])

    def _beside(self, level: Level, views: Sequence[GridView], cancelled: Callable[[], bool]) -> list[Sighting] | None:
        """Where photos lie beside the twin; None if it is cancelled."""
        with ThreadPoolExecutor(compiled.threads()) as pool:  # (shifts take longer than renders, and one core each)
            pending = []
            for view in views:
                if cancelled():
                    return None
                pending.append(pool.submit(sighted, self._laid_beside(level, view)))
            return [one.result() for one in pending]

    def _laid_beside(self, level: Level, view: GridView) -> LaidBeside:
        """A photo, and what the twin shows of it."""
        paths = self.learned.paths
        assert paths is not None
        camera = paths.stands(view.camera)
        shown = self.exposed(level, view).degraded.cpu().numpy()
        settings = replace(self.raster_settings(level), depth=True)
        with torch.no_grad():
            still = sharp_view(self.optimizer.gaussians, camera, settings, self.background)
        assert still.mean_depth is not None
        depth = torch.where(still.alpha > ADJUSTING.opaque, still.mean_depth, 0.0).cpu().numpy()
        return LaidBeside(camera, shown, view.planes(), depth, view.valid)

    def _seen(self, photos: list[tuple[Camera, torch.Tensor | None]], settings: RasterSettings) -> SeenByPhotos:
        """What the photos see of each Gaussian; every rank looks at some of them."""
        own, gaussians = photos[self.ranks.rank :: self.ranks.count], self.optimizer.gaussians
        if self.ranks.alone:
            return seen_by(gaussians, own, settings)
        found = seen_by(gaussians, own, settings) if own else SeenByPhotos.nothing(len(gaussians), self.device)
        self.ranks.add(list(found.sums()))
        return found

    def _veils(self, cameras: Sequence[Camera]) -> torch.Tensor:
        """[N] bool: Gaussians that are veils before photos' cameras, on all ranks the same."""
        points = self.scale.points_to_unit(self.points.positions)
        found = torch.from_numpy(veils(self.optimizer.gaussians.means.detach().cpu().numpy(), cameras, points))
        if not self.ranks.alone:  # (centres differ in last digits where processors differ)
            agreeing = found.float()
            self.ranks.add([agreeing])
            found = agreeing > self.ranks.count - 0.5
        return found.to(self.device)

    def _counting(self, view: GridView, margin: int) -> torch.Tensor | None:
        """[H + 2m, W + 2m] float32: 1 for the px that count in a photo; None for all of them."""
        if view.valid is None:
            return None
        counting = np.pad(view.valid, margin, constant_values=True)
        return torch.from_numpy(counting.astype(np.float32)).to(self.device)

    def heldout_psnr(self) -> float | None:
        """PSNR (dB) of the degraded render against held-out photos, on the finest grid.

        Where photos have exposures of their own, those of held-out ones are taken from halves that do not judge.
        """
        level = self.levels[-1]
        if not level.heldout:
            return None
        errors = [0.0] * len(level.heldout)
        for index, view in enumerate(level.heldout):
            if index % self.ranks.count != self.ranks.rank:
                continue
            self._find_unseen(level, view)
            self.follow_unseen(level, view)
            errors[index] = self._error(level, view)
        if not self.ranks.alone:
            total = torch.tensor(errors)  # (float32: zeros of the other ranks are added)
            self.ranks.add([total])
            errors = total.tolist()
        return psnr_of(errors)

    def _error(self, level: Level, view: GridView) -> float:
        """Mean square of what the twin, as it is, shows through the medium less a photo."""
        shown, photo = self.exposed(level, view).degraded.cpu().numpy(), view.planes()
        if self.learned.exposures is not None:
            shown = exposed_by_halves(shown, photo, view.valid, view.present())
        return mean_square(shown - photo, view.valid)

    def judge_dropout(self, share: float, scores: Sequence[float]) -> bool:
        """Whether Gaussians are left out of steps from here on.

        Not where a blur is inverted, which has a price on invented detail already, nor where held-out photos have
        something of their own to be found first: what is wrong with it counts as a gap.

        Args:
            share: of the run, in [0, 1]; scores: PSNR (dB) of held-out photos so far.
        """
        level = self.levels[-1]
        if self.asked["dropout"] or share < DROPOUT.begin or not getting_worse(scores):
            return False
        if self.learned.unseen_visits or level.ratio is not None or not self.ranks.alone:
            return False
        count = min(DROPOUT.compared, len(self.views))
        fitted = [self._error(level, level.views[i * len(level.views) // count]) for i in range(count)]
        self.asked["dropout"] = int(learned_by_heart(scores[-1], psnr_of(fitted)))
        return bool(self.asked["dropout"])

    def result(self) -> Gaussians:
        """The twin so far: in the world of the cameras, as the usual viewers draw it."""
        world = self.scale.to_world(self.optimizer.gaussians)
        finite = torch.isfinite(torch.cat([t.reshape(len(world), -1) for _, t in world.named()], dim=1)).all(dim=1)
        if not bool(finite.all()):
            self.repairs["left out of the twin, non-finite"] = int((~finite).sum())
            world = Gaussians(**{name: t[finite] for name, t in world.named()})
        return widened(world, [v.camera for v in self.views], self.settings.low_pass)

    def counters(self) -> dict[str, int]:
        """What was added, removed, refused and repaired so far."""
        names = {f"refused, non-finite gradient of {n}": c for n, c in self.optimizer.refused.items()}
        refused = {"refused, non-finite gradients": sum(names.values()), **names}
        adjusted = {"cameras adjusted": self.asked["adjusted"]} if self.cameras_moved else {}
        culled = {f"culled, {_CULLED[reason]}": self.culled.get(reason, 0) for reason in _CULLED}
        always = {"dropped, non-finite Gaussians": 0, "clamped scales, most at once": 0, **self.repairs}
        return {**self.density.counts, "unneeded": self.asked["unneeded"], **adjusted, **refused, **always, **culled}

    def fingerprint(self) -> dict[str, Any]:
        """What a checkpoint must share with this run to be continued by it."""
        settings = asdict(self.settings)
        for free in ("threads", "time_limit", "device", "steps", "until", "min_steps"):
            settings.pop(free)
        psf = self.medium.psf
        if self._origin is None:
            self._origin = origin(self.views, self.heldout, self.points)
        return {
            "settings": settings,
            "photos": [v.name for v in self.views],
            **self._origin,
            "point spread": None if psf is None else np.round(psf.kernel(), 9).sum(axis=0).tolist(),
            "blur space": self.medium.blur_space,
            **({"own point spreads": self._own_spreads()} if self.medium.per_view else {}),
            **({"background": [*self._known.colour, self._known.space]} if self._known is not None else {}),
            **({"effects": {e.name: e.described() for e in self._begun.effects}} if self._begun else {}),
        }

    def _own_spreads(self) -> dict[str, str]:
        """A digest of each kernel that a photo has of its own."""
        return {
            name: "none" if psf is None else hashlib.sha256(np.round(psf.kernel(), 9).tobytes()).hexdigest()[:16]
            for name, psf in sorted(self.medium.per_view.items())
        }

    def state(self, seconds: float, history: list[dict[str, float]]) -> Checkpoint:
        """Everything that is needed to go on."""
        o, d = self.optimizer, self.density
        arrays = {**self._arrays(), **self.learned.state()}
        counters = {
            "steps": o.steps,
            **{f"density.{k}": v for k, v in d.counts.items()},
            **{f"refused.{k}": v for k, v in o.refused.items()},
            **{f"asked.{k}": v for k, v in self.asked.items()},
            **{f"culled.{k}": v for k, v in self.culled.items()},
            **{f"repair.{k}": v for k, v in self.repairs.items()},
        }
        return Checkpoint(arrays, self.fingerprint(), self.step, seconds, history, counters)

    def _arrays(self) -> dict[str, np.ndarray]:
        """Parameters, their moments and the density statistics, by name."""
        o, d = self.optimizer, self.density
        arrays = {"pull": d.gradients.cpu().numpy(), "views": d.views.cpu().numpy()}
        for name, tensor in o.gaussians.named():
            arrays[f"value.{name}"] = tensor.detach().cpu().numpy()
            arrays[f"first.{name}"] = o.first[name].cpu().numpy()
            arrays[f"second.{name}"] = o.second[name].cpu().numpy()
        return arrays

    def _take(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Goes on with what `_arrays` gave; counts stay."""
        take = lambda name: torch.from_numpy(arrays[name].copy()).to(self.device)  # noqa: E731
        before, names = self.optimizer, [name for name, _ in self.optimizer.gaussians.named()]
        self.optimizer = Adam(Gaussians(**{name: take(f"value.{name}") for name in names}))
        for name in names:
            self.optimizer.first[name], self.optimizer.second[name] = take(f"first.{name}"), take(f"second.{name}")
        self.optimizer.steps, self.optimizer.refused = before.steps, before.refused
        counts = self.density.counts
        self.density = DensityControl(len(self.optimizer.gaussians), self.device)
        self.density.gradients, self.density.views, self.density.counts = take("pull"), take("views"), counts

    def restore(self, checkpoint: Checkpoint) -> None:
        """Goes on from `checkpoint`, exactly."""
        self._take(checkpoint.arrays)
        group = lambda p: {k[len(p) :]: v for k, v in checkpoint.counters.items() if k.startswith(p)}  # noqa: E731
        self.optimizer.steps = checkpoint.counters["steps"]
        self.optimizer.refused, self.repairs, self.culled = group("refused."), group("repair."), group("culled.")
        self.asked = {**self.asked, **group("asked.")}
        self.density.counts = group("density.")
        self.step = checkpoint.step
        self.learned.restore(checkpoint.arrays)


@lru_cache(maxsize=1)
def _beside() -> ThreadPoolExecutor:
    """The thread beside that of the training: one for all trainings, as torch keeps threads of its own for each."""
    return ThreadPoolExecutor(1, "dgs-beside")


@lru_cache(maxsize=2)
def _order(seed: int, turn: int, count: int) -> list[int]:
    """In which order the photos come in one round."""
    return [int(n) for n in np.random.default_rng([seed, 1, turn]).permutation(count)]
