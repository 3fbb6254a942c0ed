"""Which device a training goes to where nobody asked for one by name."""

from __future__ import annotations

from ..devices import BackendName, quick_devices
from ..errors import DeviceError
from ..imaging.formation.exposure import Exposure
from ..imaging.formation.motion import CameraMotion
from ..machine import Machine
from ..progress import Progress
from ..training.job import TrainingJob
from ..training.quickest import seconds_of_a_pass, seconds_of_a_step


def device_for(job: TrainingJob, machine: Machine, progress: Progress) -> BackendName:
    """The machine's own device, or a graphics card that is quicker at the training.

    It is where the training's first Gaussians are rendered more quickly; and where paths are learned, partly in the
    computer's memory, where whole steps are. Focus, kernels and glass are learned there for the most part, and what
    photos show through them is made there: such trainings stay with the processor.
    """
    names = set(job.formation.names)
    if not machine.free or not names <= {Exposure.name, CameraMotion.name}:
        return machine.device
    seconds_of = seconds_of_a_step if CameraMotion.name in names else seconds_of_a_pass
    for card in quick_devices():
        try:
            own, there = seconds_of(job, machine.device), seconds_of(job, card)
        except DeviceError as error:
            progress.note(f"The graphics card is left alone: {error.what}")
            continue
        if there < own:
            progress.note(
                f"Trained on the graphics card, which is {own / there:.1f} times as fast at it as the processor here"
                " (--device cpu keeps to the processor)"
            )
            return card
    return machine.device
