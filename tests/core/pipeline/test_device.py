"""Where a training goes that nobody asked a device for: to a card that is quicker, and back when it fails."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from dgs.core import devices as registry
from dgs.core.devices import quick_devices
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.exposure import Exposure
from dgs.core.imaging.formation.kernels import PhotoKernels
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.machine import Machine
from dgs.core.pipeline import device as choice
from dgs.core.pipeline.device import device_for
from dgs.core.pipeline.timing import NoteKeeper
from dgs.core.pipeline.training import _on
from dgs.core.progress import Silent
from dgs.core.training.job import TrainingJob
from dgs.core.training.quickest import seconds_of_a_pass, seconds_of_a_step
from dgs.core.training.run import RUN
from dgs.tests.back_ends import or_skip
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene

ROOT = Path(__file__).resolve().parents[3]
FREE = Machine(1, "cpu", free=True)


@pytest.fixture(scope="module")
def job() -> TrainingJob:
    scene = blurred_scene(4)
    return TrainingJob(scene.views, [], scene.points, scene.medium, SHORT)


@pytest.fixture
def card_at_hand(monkeypatch):
    """Software that stands in for a card, taken for one."""
    or_skip("gpu")
    monkeypatch.setattr(type(registry.backend_named("gpu")), "quick", lambda self: True)


def software_or_skip() -> None:
    """Skips where there is a real card."""
    or_skip("gpu")
    from dgs.core.backends.gpu.adapter import adapters, is_software

    if not is_software(adapters()[0]):
        pytest.skip("there is a graphics card")


def test_software_is_no_card(job):
    software_or_skip()
    notes = NoteKeeper(Silent())
    assert quick_devices() == () and device_for(job, FREE, notes) == "cpu" and not notes.notes


def test_a_slower_card_is_left_alone(job, card_at_hand):
    """The real passes are timed; software that draws as a card does is always slower than the processor's kernels."""
    software_or_skip()
    notes = NoteKeeper(Silent())
    assert seconds_of_a_pass(job, "gpu") > seconds_of_a_pass(job, "cpu") > 0
    assert device_for(job, FREE, notes) == "cpu" and not notes.notes


def test_a_quicker_card_is_taken_unless_somebody_chose(job, card_at_hand, monkeypatch):
    monkeypatch.setattr(choice, "seconds_of_a_pass", lambda _, device: {"cpu": 0.6, "gpu": 0.2}[device])
    notes = NoteKeeper(Silent())
    assert device_for(job, FREE, notes) == "gpu"
    assert len(notes.notes) == 1 and "3.0 times" in notes.notes[0] and "--device cpu" in notes.notes[0]
    assert device_for(job, Machine(1, "cpu"), notes) == "cpu"
    names = [view.name for view in job.views]
    for effect, device in ((Exposure(names, torch.zeros(4, 3)), "gpu"), (PhotoKernels.sharp(names), "cpu")):
        assert device_for(replace(job, formation=Formation([effect])), FREE, NoteKeeper(Silent())) == device


def shaken(job: TrainingJob) -> TrainingJob:
    ways = {view.name: (0.02, 0.01 * i) for i, view in enumerate(job.views)}
    return replace(job, formation=Formation([straight_paths(ways, 2)]))


def test_where_paths_are_learned_whole_steps_are_compared(job, card_at_hand, monkeypatch):
    monkeypatch.setattr(choice, "seconds_of_a_pass", lambda *_: pytest.fail("renders alone say little here"))
    monkeypatch.setattr(choice, "seconds_of_a_step", lambda _, device: {"cpu": 0.6, "gpu": 0.3}[device])
    notes = NoteKeeper(Silent())
    assert device_for(shaken(job), FREE, notes) == "gpu" and "2.0 times" in notes.notes[0]


def test_steps_that_are_timed_leave_the_job_as_it_was(job):
    or_skip("gpu")
    asked = shaken(job)
    before = asked.formation.motion.parameters["twists"].clone()
    assert seconds_of_a_step(asked, "gpu") > 0 and seconds_of_a_step(asked, "cpu") > 0
    assert torch.equal(asked.formation.motion.parameters["twists"], before)


def test_asked_by_name_it_is_nobody_s_choice():
    assert Machine.ready(1, "auto").free and not Machine.ready(1, "cpu").free


LOST = """
import json, sys
from pathlib import Path
import run_dgs; run_dgs.mount_package()
from dgs.core.devices import backend_named
from dgs.core.machine import Machine
from dgs.core.pipeline import device
from dgs.core.pipeline.timing import NoteKeeper
from dgs.core.pipeline.training import _on
from dgs.core.pipeline.training import train_twin
from dgs.core.progress import Silent
from dgs.core.training import run
from dgs.core.training.job import TrainingJob
from dgs.core.training.trainer import Trainer
from dgs.core.twin.folder import TwinFolder
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene

kept, lost = int(sys.argv[2]), []
type(backend_named("gpu")).quick = lambda self: True
device.seconds_of_a_pass = lambda job, name: {"cpu": 0.6, "gpu": 0.2}[name]
advance, save = Trainer.advance, run._Run._save

def until_lost(trainer, share):
    if trainer.device.type == "gpu" and trainer.step == 20:
        from dgs.core.backends.gpu.card import card
        if kept:
            save(runs[-1], 1.0)
        lost.append(trainer.step)
        card()._device.destroy()
    return advance(trainer, share)

runs, begin = [], run._Run.__init__
def remembered(self, *arguments):
    begin(self, *arguments)
    runs.append(self)

Trainer.advance, run._Run.__init__ = until_lost, remembered
scene, notes, folder = blurred_scene(4), NoteKeeper(Silent()), TwinFolder(Path(sys.argv[1]))
job = TrainingJob(scene.views, [], scene.points, scene.medium, SHORT)
trained = train_twin(job, Machine(1, "cpu", free=True), False, False, folder, notes)
assert lost == [20] and trained.steps == SHORT.steps and trained.settings.device == "cpu", (lost, trained.settings)
print(json.dumps(notes.notes))
"""


@pytest.mark.parametrize("kept", [1, 0])
def test_a_card_lost_in_the_middle_leaves_the_rest_to_the_processor(tmp_path, kept):
    """From the last checkpoint, and from the beginning where there is none yet. The card is really lost."""
    or_skip("gpu")
    command = [sys.executable, "-c", LOST, str(tmp_path), str(kept)]
    run = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:]
    assert "goes on with the processor" in run.stdout
    assert ("Going on from step 20" in run.stdout) is bool(kept)
    assert (tmp_path / "twin.ply").is_file()


def test_what_was_spent_on_the_choice_is_not_there_to_train(job):
    limited = replace(job, settings=replace(job.settings, time_limit=10.0))
    assert 6.9 < _on(limited, "cpu", time.perf_counter() - 3.0).settings.time_limit <= 7.0
    assert _on(limited, "cpu", time.perf_counter() - 60.0).settings.time_limit == 10.0 * RUN.least_iterating
    assert _on(job, "cpu", time.perf_counter() - 60.0).settings.time_limit is None
