"""The stages 'training' and 'scores' of an update: the twin goes on from where its own training ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch

from ..errors import Cancelled, CheckpointError
from ..forward.compare import mask_of, mean_square, psnr_of
from ..gaussians import Gaussians
from ..imaging.medium import Medium
from ..numbers import number
from ..progress import Progress
from ..training.checkpoint import load_checkpoint
from ..training.grid import GridView
from ..training.level import Level
from ..training.origin import cameras_of
from ..training.scale import scene_scale
from ..training.settings import TrainingSettings
from ..training.trainer import Trainer
from ..training.warmup import compile_kernels
from ..twin.folder import TwinFolder
from ..twin.opened import OpenedTwin
from ..views import View


@dataclass(frozen=True)
class ContinuedSettings:
    """How an update trains."""

    begin: float = number(
        0.5, "share", "of the schedule at which it begins: steps are small, density control still works"
    )
    round: float = number(0.06, "share", "of the twin's own steps that a round takes")
    rounds: int = number(4, "rounds", "at most")
    behind: float = number(
        1.0, "dB", "another round follows as long as new photos are explained worse than held-out old ones by this"
    )
    fewest_steps: int = number(20, "steps", "of a round at least, however short the twin's own training was")
    watched: int = number(8, "views", "at most, that show whether anything old was forgotten")
    asked_every: int = number(10, "steps", "between two questions whether the user wants to stop")


CONTINUED = ContinuedSettings()
#: Settings that the twin was trained with and an update keeps.
_KEPT = ("sh_degree", "loss", "low_pass", "variation_weight", "inverse_weight", "base_weight")


class Updater(Trainer):
    """A trainer that looks at new photos every second step."""

    fresh: frozenset[str] = frozenset()

    def view_at(self, level: Level, step: int) -> GridView:
        """New and old photos in turn, each group in random order, every photo once per round."""
        group = [v for v in level.views if (v.name in self.fresh) == (step % 2 == 0)] or level.views
        turn = step // 2
        random = np.random.default_rng([self.settings.seed, 4, step % 2, turn // len(group)])
        return group[int(random.permutation(len(group))[turn % len(group)])]


@dataclass(frozen=True)
class UpdateViews:
    """What an update trains on.

    Attributes:
        old: views of the twin's own training, without px that show what has changed; new: those of new photos.
        medium: with the new photos' point spreads.
    """

    old: Sequence[View]
    new: Sequence[View]
    medium: Medium


@dataclass(frozen=True)
class Explained:
    """PSNR (dB) of the twin through the blur against old photos, held-out ones where there are, and new ones."""

    old: float
    new: float


class ContinuedTraining:
    """A training that stands where the twin's own ended.

    Args:
        twin: as it is; views: what to train on.
        share: of the twin's own steps, in one round; None for as many rounds as new photos ask for.
        seed, threads: of the training; threads None leaves them as they are.

    Raises:
        CheckpointError: the optimizer's state is not there.
    """

    def __init__(
        self, twin: OpenedTwin, views: UpdateViews, share: float | None, seed: int, threads: int | None
    ) -> None:
        folder = TwinFolder(twin.folder)
        if not folder.checkpoint.is_file():
            raise CheckpointError(
                f"'{twin.folder}' has no checkpoint.npz, the optimizer's state", "Reconstruct it again"
            )
        state, report = load_checkpoint(folder.checkpoint, {}), folder.report()
        self._twin, self._views, self._share = twin, views, share
        wanted = (CONTINUED.round if share is None else share) * int(report["steps"])
        self._steps = max(CONTINUED.fewest_steps, round(wanted))
        count = len(state.arrays["value.means"])
        settings = replace(
            _own_settings(twin, report["settings"]["training"]),
            steps=self._steps,
            max_gaussians=max(count, round(count * (1.0 + len(views.new) / max(1, len(views.old))))),
            seed=seed,
            threads=threads or 0,
            time_limit=None,
            coarse_share=0.0,
        )
        compile_kernels(settings.sh_degree)
        photos = set(state.fingerprint.get("photos", []))
        seen = [view for view in twin.views if view.name in photos] or twin.kept
        # (adjusted since, maybe; the unit is that of the cameras which the training began with)
        cameras = cameras_of(state.fingerprint, {view.name: view.camera for view in seen})
        scale = scene_scale(cameras, twin.reconstruction.points)
        names = [field.name for field in fields(Gaussians)]
        values = Gaussians(**{name: torch.from_numpy(state.arrays[f"value.{name}"].copy()) for name in names})
        start, points = scale.to_world(values), twin.reconstruction.points
        self.trainer = Updater([*views.old, *views.new], [], points, views.medium, settings, start=start)
        self.trainer.fresh = frozenset(view.name for view in views.new)
        optimizer = self.trainer.optimizer
        for name in names:
            optimizer.first[name] = torch.from_numpy(state.arrays[f"first.{name}"].copy())
            optimizer.second[name] = torch.from_numpy(state.arrays[f"second.{name}"].copy())
        optimizer.steps = int(state.counters["steps"])

    def run(self, progress: Progress) -> tuple[Gaussians, Explained]:
        """Trains; the twin in world units, and how well it explains the photos now.

        Raises:
            Cancelled: the user asked to stop.
        """
        for _ in range(CONTINUED.rounds):
            progress.stage("update", self._steps)
            self._round(progress)
            gaussians = self.trainer.result()
            after = explained(self._twin, gaussians, self._views)
            if self._share is not None or after.new > after.old - CONTINUED.behind:
                break
        return gaussians, after

    def _round(self, progress: Progress) -> None:
        for step in range(self._steps):
            self.trainer.advance(CONTINUED.begin + (1.0 - CONTINUED.begin) * step / self._steps)
            if (step + 1) % CONTINUED.asked_every == 0:
                progress.advance(step + 1)
                if progress.cancelled():
                    raise Cancelled("Stopped; the twin is as it was")


def explained(twin: OpenedTwin, gaussians: Gaussians, views: UpdateViews) -> Explained:
    """How well Gaussians explain old photos through the twin's medium, and new ones through theirs."""
    old = [view for view in twin.views if view.name in twin.held] or twin.views
    watched = old[:: max(1, -(-len(old) // CONTINUED.watched))]
    return Explained(_psnr(twin, gaussians, twin.medium, watched), _psnr(twin, gaussians, views.medium, views.new))


def _psnr(twin: OpenedTwin, gaussians: Gaussians, medium: Medium, views: Sequence[View]) -> float:
    """PSNR (dB) of the twin through the blur against photos."""
    changed = replace(twin, medium=medium)
    unit, model = twin.scale.to_unit(gaussians), changed.model(twin.margin(twin.step))
    errors = []
    for view in changed.on_grid(list(views), twin.step):
        with torch.no_grad():
            exposed = model.expose(unit, view, twin.background)
            errors.append(mean_square(exposed.residual(torch.from_numpy(view.planes())), mask_of(view.valid)))
    return round(psnr_of(errors), 3)


def _own_settings(twin: OpenedTwin, used: dict[str, Any]) -> TrainingSettings:
    """Of the twin's own training, what an update keeps."""
    kept = {name: used[name] for name in _KEPT if name in used}
    return replace(TrainingSettings.preset(twin.settings.training.preset), **kept)
