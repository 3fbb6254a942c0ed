"""The stage 'training': Gaussians fitted to the photos, within the time there is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..devices import BackendName
from ..errors import DeviceError
from ..imaging.formation.chain import Formation
from ..machine import Machine
from ..photos.load import Photo
from ..progress import Progress
from ..run_settings import TrainingRequest
from ..training.density.budget import ample_gaussians, supported_gaussians
from ..training.job import PlannedTraining, TrainingJob
from ..training.ranks import ALONE, OtherRankFinishes, Ranks
from ..training.run import RUN, Trained, train
from ..training.settings import BLUR_WIDTH, TrainingSettings, harmonics_for, preset_for_sharp
from ..twin.folder import TwinFolder
from ..views import View
from .device import device_for
from .snapshots import Watchers
from .timing import Timing

#: A run that waits for a quality takes at most this many times the preset's steps.
UNTIL_STEPS = 4


def usual_settings(request: TrainingRequest, machine: Machine) -> TrainingSettings:
    """The preset, with what every training of the run shares: loss, seed and machine."""
    preset = TrainingSettings.preset(request.preset)
    return replace(preset, loss=request.loss, seed=request.seed, threads=machine.threads, device=machine.device)


@dataclass(frozen=True)
class Shown:
    """What the photos show, as far as that was found out.

    Attributes:
        sigma: px, of the photos' blur (`Medium.mean_sigma`).
        formation: what is simulated besides it; None as long as nothing is known of it.
        views: photos that are fitted.
    """

    sigma: float
    formation: Formation | None = None
    views: Sequence[View] = ()

    @property
    def sharp(self) -> bool:
        """Whether nothing blurs the photos, as far as is known, but motion of the camera."""
        return self.formation is not None and not self.formation.spreads and self.sigma <= BLUR_WIDTH.sharp_until

    def amply(self, degree: int) -> int:
        """Gaussians that sharp photos of a camera that stood still show amply; 0 for others. `degree`: of harmonics."""
        still = self.formation is not None and not self.formation.blurs
        return ample_gaussians(self.views, degree) if self.sharp and still else 0


def training_settings(request: TrainingRequest, machine: Machine, limited: bool, shown: Shown) -> TrainingSettings:
    """The settings of the optimization; `limited`: whether a time limit will say how many steps there are."""
    usual = usual_settings(request, machine)
    degree = harmonics_for(usual, shown.sigma) if request.sh_degree is None else request.sh_degree
    if shown.sharp:
        usual = preset_for_sharp(usual, shown.amply(degree))
    settings = replace(
        usual,
        sh_degree=degree,
        max_gaussians=usual.max_gaussians if request.max_gaussians is None else request.max_gaussians,
        until=usual.until if request.until is None else request.until,
        min_steps=request.min_steps,
    )
    if request.until is None or limited:
        return settings
    return replace(settings, steps=max(UNTIL_STEPS * settings.steps, settings.min_steps))


def fit_into_time(
    job: TrainingJob, photos: Sequence[Photo], fixed: int | None, resume: bool, timing: Timing, folder: TwinFolder
) -> PlannedTraining:
    """The training that the time allows; its plan is kept in the folder.

    Args:
        photos: those with a camera; fixed: Gaussians, where the user wants so many; else no more than the photos can
            hold.
        resume: go on with the plan in the folder.

    Raises:
        OutputError: the plan cannot be written.
    """
    planned = timing.plan(job, photos, fixed, folder.plan() if resume else None)
    if planned.plan is not None:
        folder.save_plan(planned.plan)
    if fixed is not None:
        return planned
    most = supported_gaussians(job.views, planned.settings.sh_degree)
    return replace(planned, settings=replace(planned.settings, max_gaussians=min(planned.settings.max_gaussians, most)))


def train_twin(
    job: TrainingJob,
    machine: Machine,
    resume: bool,
    snapshots: bool,
    folder: TwinFolder,
    progress: Progress,
    ranks: Ranks = ALONE,
) -> Trained:
    """Trains, and keeps checkpoints, snapshots and the twin in the folder.

    A card that was taken unasked and fails leaves the rest to the machine's own device.

    Args:
        ranks: processes that train together; `resume` is rank 0's.

    Raises:
        CheckpointError, TrainingError, OutputError, DeviceError: see `train`. OtherRankFinishes: this is not rank 0.
    """
    watch = Watchers(folder, snapshots) if ranks.rank == 0 else None
    begun = time.perf_counter()
    device = device_for(job, machine, progress) if ranks.alone else machine.device
    try:
        trained = train(_on(job, device, begun), progress, folder.checkpoint, resume, watch, ranks)
    except DeviceError as error:
        if device == machine.device:
            raise
        progress.note(f"{error.what}: the training goes on with the processor, from what was kept of it last")
        trained = train(_on(job, machine.device, begun), progress, folder.checkpoint, True, watch, ranks)
    if ranks.rank:
        raise OtherRankFinishes
    if progress.cancelled() and trained.stopped == "done" and trained.steps < job.settings.steps:
        trained.stopped = "cancelled"
    folder.save_twin(trained.gaussians.cloud())
    return trained


def _on(job: TrainingJob, device: BackendName, begun: float) -> TrainingJob:
    """The same training on a device, within what is left of its time since `begun` (on `time.perf_counter`)."""
    limit = job.settings.time_limit
    if limit is not None:
        limit = max(limit - (time.perf_counter() - begun), RUN.least_iterating * limit)
    return replace(job, settings=replace(job.settings, device=device, time_limit=limit))
