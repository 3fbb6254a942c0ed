"""The optimization, step by step: render one photo's view, ask the objective, follow the gradient."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import lru_cache
from typing import SupportsFloat

import numpy as np
import torch

from ..constants import SH_COEFFICIENTS
from ..devices import backend_on
from ..errors import TrainingError
from ..forward import Exposed, ForwardModel
from ..gaussians import Gaussians
from ..imaging.formation.focus import OUT_OF_FOCUS
from .density.control import DensityControl
from .density.dropout import left_out
from .density.finest import hold_sizes, narrowest_blur
from .following import ask_path, find_focus, follow_focus, follow_kernel
from .grid import GridView
from .guards import GUARDS, drop_non_finite
from .kept_state import follow_first
from .level import Level
from .loss.through_glass import GlassObjective
from .optics.kernels import SETTINGS as KERNELS
from .ranks import RankLost, Ranks
from .restored.course import COURSE, Part, part_of
from .restored.photos import RestoredPhotos
from .restored.start import begin_anew, restores
from .scene import TrainedScene
from .schedule import harmonics_degree
from .settings import calm_end, rates_of_long_runs


class Trainer(TrainedScene):
    """One run of the optimization; arguments as of `TrainedScene`."""

    _restored: RestoredPhotos | None = None

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
        follow_first(self)

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
        if self.known_background is not None:
            return self.background
        shake = self.settings.backdrop * np.random.default_rng([self.settings.seed, 3, self.step]).uniform(-1, 1, 3)
        return self.background + torch.from_numpy(shake).to(self.background)

    def advance(self, share: float) -> SupportsFloat:
        """One iteration at a share in [0, 1) of the run; returns the photo's loss (to read it may wait for a card)."""
        part = self.part(share)
        if part.restored:
            return self._follow_restored(part.share)
        self._restored = self.restored_around = None
        return self._follow_photo(part.share)

    def part(self, share: float) -> Part:
        """Where the run is at a share in [0, 1] of it."""
        return part_of(share, self.restore and restores(self))

    def _follow_restored(self, share: float) -> SupportsFloat:
        """Fits the Gaussians to some restored photos, at a share in [0, 1) of this part of the run; the last loss."""
        if self._restored is None:
            around = self.restored_around
            self._restored = begin_anew(self) if around is None else RestoredPhotos(around)
        level, backdrop = self.levels[-1], self.backdrop()
        loss: SupportsFloat = 0.0
        still = ForwardModel(self.raster_settings(level), lambda v: self.objective(level, v).medium, level.margin)
        for turn in range(COURSE.photos_at_a_step):
            view = self.view_at(level, self.step * COURSE.photos_at_a_step + turn)
            photo = self._restored.of(self, level, view)
            exposed = still.expose(self._shown(share), view, backdrop)
            found = self.objective(level, view).loss(exposed.reached, photo.planes, self.counting(view))
            exposed.backward(found.gradient if photo.weight is None else found.gradient * photo.weight)
            self._collect(exposed)
            self.optimizer.step(self.rates(share))
            loss = found.loss
        self._end_step(share, COURSE.photos_at_a_step)
        return loss

    def _follow_photo(self, share: float) -> SupportsFloat:
        """Fits Gaussians, and what is learned of each photo, to one photo, at a share in [0, 1) of this part."""
        s = self.settings
        level = self.levels[0] if share < s.coarse_share else self.levels[-1]
        view = self.view_at(level, self.step + self.ranks.rank)
        find_focus(self, level, share)
        backdrop = self.backdrop()
        exposed = self.model(level).expose(self._shown(share), view, backdrop)
        compared = self.photo_on_device(level, view, backdrop)
        photo, valid = compared.planes, compared.valid
        objective = self.objective(level, view)
        asked = self.learned.asked(view, exposed, photo, share)
        wanted = photo if asked is None else asked.photo
        weight = None if asked is None else asked.weight
        take = ask_path(self, level, view, exposed, wanted, backdrop)
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
        follow_focus(self, view, exposed, wanted)
        if share >= KERNELS.begin:
            follow_kernel(self, view, exposed, wanted)
        if self.learned.glass is not None:
            self.learned.glass.learn(view.name, exposed, wanted, valid, share)
        self.optimizer.step(self.rates(share), self.ranks.count)
        self._end_step(share)
        return loss

    def _end_step(self, share: float, photos: int = 1) -> None:
        """Counts a step, of which each followed so many photos, and does what is due now and then."""
        s = self.settings
        self.step += self.ranks.count
        if self._passed(GUARDS.every):
            self._guard()
        if self._passed(max(GUARDS.every, len(self.views))):  # (every photo is asked: of many, less often)
            self._hold_sizes()
        if self._passed(max(1, s.density_every // photos)) and share < s.density_until:
            self.density.act(self.optimizer, s.max_gaussians, np.random.default_rng([s.seed, 2, self.step]))
            follow_first(self)

    def _guard(self) -> None:
        """Checks all parameters; counts what was repaired."""
        found = backend_on(self.device).guard(self.optimizer.gaussians, self.centres)
        for name, count in (("limited sizes", found.limited), ("clamped scales", found.clamped)):
            most = f"{name}, most at once"
            self.repairs[most] = max(self.repairs.get(most, 0), count)
        if not found.broken:
            return
        for name, count in drop_non_finite(self.optimizer, self.step).items():
            self.repairs[f"dropped, non-finite {name}"] = self.repairs.get(f"dropped, non-finite {name}", 0) + count
            self.density = DensityControl(len(self.optimizer.gaussians), self.device)

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


@lru_cache(maxsize=2)
def _order(seed: int, turn: int, count: int) -> list[int]:
    """In which order the photos come in one round."""
    return [int(n) for n in np.random.default_rng([seed, 1, turn]).permutation(count)]
