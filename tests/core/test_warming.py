"""A card that is made ready on a thread of its own: only where one may be taken, and what goes wrong is said later."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest
from dgs.core import warming
from dgs.core.errors import DeviceError
from dgs.core.warming import begin_warming, finish_warming
from dgs.tests.back_ends import or_skip

ROOT = Path(__file__).resolve().parents[2]


class Card:
    """Stands in for a back end."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error, self.go = error, threading.Event()
        self.threads: list[str] = []

    def warm(self) -> None:
        self.threads.append(threading.current_thread().name)
        self.go.wait(10.0)
        finish_warming()  # (as every use of a card does; the thread does not wait for itself)
        if self.error is not None:
            raise self.error
        self.threads.append("done")


@pytest.fixture
def card(monkeypatch):
    found = Card()
    monkeypatch.setattr(warming, "backend_named", lambda name: found)
    monkeypatch.setattr(warming, "quick_devices", lambda: ("gpu",))
    yield found
    found.go.set()
    finish_warming()


def test_a_processor_warms_nothing(card):
    begin_warming("cpu", False)
    assert warming._under_way is None and card.threads == []


@pytest.mark.parametrize(("device", "free"), [("gpu", False), ("cpu", True)])
def test_a_card_is_warmed_beside_the_run_and_waited_for(card, device, free):
    begin_warming(device, free)
    assert "done" not in card.threads
    card.go.set()
    finish_warming()
    assert card.threads == ["dgs-warming", "done"] and warming._under_way is None


def test_what_goes_wrong_is_not_said_here(card):
    card.error = DeviceError("The graphics card is on fire", "Use --device cpu")
    card.go.set()
    begin_warming("gpu", False)
    finish_warming()
    assert card.threads == ["dgs-warming"]


def script(code: str) -> subprocess.CompletedProcess[str]:
    """A process of its own, since a card is opened once in each."""
    start = "import run_dgs, sys; run_dgs.mount_package(); from dgs.core.warming import *\n"
    return subprocess.run([sys.executable, "-c", start + code], cwd=ROOT, check=False, capture_output=True, text=True)


def test_nothing_of_a_card_is_loaded_for_a_processor():
    found = script("begin_warming('cpu', False); finish_warming(); sys.exit('wgpu' in sys.modules)")
    assert found.returncode == 0, found.stderr


def test_nor_where_there_is_none():
    from dgs.core.backends.gpu.adapter import may_have_card

    if may_have_card():
        pytest.skip("there is a graphics device to be looked at")
    found = script("begin_warming('cpu', True); finish_warming(); sys.exit('wgpu' in sys.modules)")
    assert found.returncode == 0, found.stderr


WARMED = """
import torch
from dgs.core.devices import backend_named
begin_warming("gpu", False)
backend_named("gpu").check()
assert not torch.autograd.is_multithreading_enabled()  # (each thread has this of its own)
from dgs.core.backends.gpu.card import card
ready = set(card()._kernels)
from dataclasses import replace
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene
scene = blurred_scene(4)
trainer = Trainer(scene.views, [], scene.points, scene.medium, replace(SHORT, device="gpu"))
for _ in range(3):
    trainer.advance(0.5)
from dgs.tests.back_ends import brought_up
assert (brought_up(torch.ones(4, 1)) * brought_up(torch.ones(1, 3))).shape == (4, 3)
late = {name for name in set(card()._kernels) - ready if "/" not in name}
assert late <= {"scan_totals"}, late
assert "sympy" not in sys.modules and "torch.distributed.tensor" not in sys.modules
import torch.distributed.tensor
assert torch.distributed.tensor.DTensor.__module__.startswith("torch")
"""


def test_a_training_finds_its_shaders_compiled():
    """Besides those for a length of lines, and for more keys than this scene has; and torch has not loaded sympy."""
    or_skip("gpu")
    found = script(WARMED)
    assert found.returncode == 0, found.stderr[-3000:]


FAILS = """
from dgs.core.backends.gpu import card as module
from dgs.core.devices import backend_named
from dgs.core.errors import DeviceError
def lost(card, kernel):
    raise RuntimeError("the device is lost")
module.Card._compiled = lost
begin_warming("gpu", False)
backend_named("gpu").check()
try:
    module.card().compile("blur")
except DeviceError as error:
    print(error.what)
"""


def test_a_card_that_fails_says_so_at_its_first_use():
    or_skip("gpu")
    found = script(FAILS)
    assert found.returncode == 0, found.stderr[-3000:]
    assert "failed: the device is lost" in found.stdout
    assert "Traceback" not in found.stderr
