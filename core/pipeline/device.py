"""Which device a training goes to where nobody asked for one by name."""

from __future__ import annotations

from ..devices import BackendName, quick_devices
from ..errors import DeviceError
from ..imaging.formation.exposure import Exposure
from ..machine import Machine
from ..progress import Progress
from ..training.job import TrainingJob
from ..training.quickest import seconds_of_a_pass


def device_for(job: TrainingJob, machine: Machine, progress: Progress) -> BackendName:
    """The machine's own device, or a graphics card on which the training's first Gaussians are rendered more quickly.

    A camera's motion, focus, kernels and glass are learned in the computer's memory, and what photos show through them
    is made there: such trainings stay with the processor.
    """
    if not machine.free or not set(job.formation.names) <= {Exposure.name}:
        return machine.device
    for card in quick_devices():
        try:
            own, there = seconds_of_a_pass(job, machine.device), seconds_of_a_pass(job, card)
        except DeviceError as error:
            progress.note(f"The graphics card is left alone: {error.what}")
            continue
        if there < own:
            progress.note(
                f"Trained on the graphics card, which renders {own / there:.1f} times as fast as the processor here"
                " (--device cpu keeps to the processor)"
            )
            return card
    return machine.device
