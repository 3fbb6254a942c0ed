"""Several ranks train one twin: real processes, started by torchrun, that meet over gloo.

One start of two ranks covers agreement and the same bits; a rank that dies, and ranks that differ, are started apart.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.core.gaussians import Gaussians
from dgs.core.training.optimizer import Adam
from dgs.core.training.origin import rank_difference
from dgs.core.training.ranks import ALONE, Ranks, started_together
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, same

ROOT = Path(__file__).resolve().parents[3]
#: Trains the tests' scene as one of several ranks; the words name a checkpoint, a seed by rank, and who dies when.
PROGRAM = """
import os, sys
sys.path.insert(0, {root!r})
import run_dgs
run_dgs.mount_package()
import json
import signal
from dataclasses import replace
from pathlib import Path
import numpy as np
from dgs.core.errors import DgsError
from dgs.core.progress import Silent
from dgs.core.training.job import TrainingJob
from dgs.core.training.ranks import join_ranks, leave_ranks
from dgs.core.training.run import train
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene

signal.signal(signal.SIGTERM, signal.SIG_IGN)  # (the command line lets work end at a safe point)
asked = json.loads(sys.argv[1])
ranks = join_ranks()
scene = blurred_scene(7)
with np.load(Path(asked["folder"]) / "photos.npz") as photos:  # (as ranks do: one set of files, whoever made it)
    views = [replace(view, photo=photos[view.name]) for view in scene.views]
settings = replace(SHORT, steps=asked["steps"], seed=asked["seeds"][ranks.rank])
job = TrainingJob(views[1:], views[:1], scene.points, scene.medium, settings)
place = Path(asked["folder"])

def watch(trainer):
    if ranks.rank == asked["dies"] and trainer.step >= asked["steps"] // 2:
        os._exit(9)

class Heard(Silent):
    def note(self, text):
        if ranks.rank == 0:
            print("NOTE", text, flush=True)

name = "checkpoint.npz" if ranks.rank == 0 else f"checkpoint_{{ranks.rank}}.npz"
try:
    trained = train(job, Heard(), place / name, asked["resume"], watch, ranks)
except DgsError as error:
    (place / f"error_{{ranks.rank}}.txt").write_text(f"{{type(error).__name__}}: {{error}}")
    os._exit(2)
digests = [float(t.double().sum()) for _, t in trained.gaussians.named()]
(place / f"twin_{{ranks.rank}}.json").write_text(json.dumps([digests, trained.steps, trained.history[-1]]))
leave_ranks()  # (as the command does: gloo's threads must have ended before the process does)
"""


def started(folder: Path, count: int, **asked) -> subprocess.CompletedProcess:
    folder.mkdir(exist_ok=True)
    program = folder / "program.py"
    program.write_text(PROGRAM.format(root=str(ROOT)))
    np.savez(folder / "photos.npz", **{view.name: view.photo for view in blurred_scene(7).views})
    words = json.dumps({"folder": str(folder), "steps": 24, "seeds": [3] * count, "dies": -1, "resume": False, **asked})
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(count)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
    return subprocess.run(
        [*command, str(program), words], capture_output=True, text=True, check=False, env=environment, timeout=200
    )


def twin(folder: Path, rank: int) -> list:
    return json.loads((folder / f"twin_{rank}.json").read_text())


@pytest.fixture(scope="module")
def two(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    done = started(folder, 2)
    said = [file.read_text() for file in folder.glob("error_*.txt")]
    assert done.returncode == 0, (said, done.stderr[-3000:])
    assert "2 ranks; " in done.stdout
    return folder


def test_two_ranks_end_with_the_same_twin(two):
    (first, steps, row), (second, *_) = twin(two, 0), twin(two, 1)
    assert first == second and steps == 24
    assert row["heldout_psnr"] == twin(two, 1)[2]["heldout_psnr"] > 20


def test_three_ranks_go_on_from_the_checkpoint_of_two_and_a_dead_one_leaves_its_own(two, tmp_path):
    """Resumed with another number; one dies in the middle: the others end with an error, rank 0 with a checkpoint."""
    (tmp_path / "checkpoint.npz").write_bytes((two / "checkpoint.npz").read_bytes())
    done = started(tmp_path, 3, steps=60, resume=True, dies=2)
    assert done.returncode != 0
    with np.load(tmp_path / "checkpoint.npz") as kept:
        facts = json.loads(kept["__facts__"].tobytes())
    assert 24 < facts["step"] < 60 and "Going on from step 24" in done.stdout
    assert "RankLost: Another rank died" in (tmp_path / "error_0.txt").read_text()


def test_a_rank_with_another_seed_is_refused_by_name(tmp_path):
    assert started(tmp_path, 2, seeds=[3, 4]).returncode != 0
    said = (tmp_path / "error_0.txt").read_text()
    assert "RanksDiffer: Rank 1 on " in said and "has another seed (4, not 3)" in said


def test_what_differs_is_named():
    facts = {
        "version": "1",
        "settings": {"seed": 1},
        "contents": {"a": "x", "b": "y"},
        "held out": {},
        "cameras": {},
        "blur space": "srgb",
    }
    assert rank_difference(facts, facts) is None
    for change, words in (
        ({"version": "2"}, "runs version 2, not 1"),
        ({"settings": {"seed": 5}}, "has another seed (5, not 1)"),
        ({"contents": {"a": "x", "b": "z"}}, "has another photo 'b'"),
        ({"contents": {"a": "x"}}, "lacks the photo 'b'"),
        ({"contents": {"a": "x", "b": "y", "c": "z"}}, "has one more photo, 'c'"),
        ({"blur space": "linear"}, "has another blur space"),
    ):
        said = rank_difference(facts, {**facts, **change})
        assert said is not None and words in said


def test_alone_nothing_is_said(monkeypatch):
    assert ALONE.alone and ALONE.any(True) and not ALONE.any(False)
    assert ALONE.bytes_of_first(b"x") == b"x" and ALONE.bytes_of_first(None) is None
    for count, together in (("1", False), ("2", True), ("x", False)):
        monkeypatch.setenv("WORLD_SIZE", count)
        monkeypatch.setenv("MASTER_ADDR", "here")
        assert started_together() is together
    monkeypatch.delenv("MASTER_ADDR")
    monkeypatch.setenv("WORLD_SIZE", "2")
    assert not started_together()


def test_two_ranks_add_what_two_photos_ask(monkeypatch):
    """The mean of two photos' gradients is followed, and both are counted: as if one process had rendered both."""
    scene = blurred_scene(6)
    trainers = [Trainer(scene.views, [], scene.points, scene.medium, SHORT) for _ in range(2)]
    said: list[list[torch.Tensor]] = []

    def first_round(self, tensors):
        said.append([tensor.clone() for tensor in tensors])

    def second_round(self, tensors):
        for tensor, *parts in zip(tensors, *said, strict=True):
            tensor.copy_(sum(parts))

    monkeypatch.setattr(Ranks, "arrays_of_first", lambda self, arrays: dict(arrays))
    monkeypatch.setattr(Ranks, "add", first_round)
    for rank in range(2):
        probe = Trainer(scene.views, [], scene.points, scene.medium, SHORT)
        probe.join(Ranks(rank, 2))
        probe.advance(0.0)
    assert not torch.equal(said[0][0], said[1][0])
    monkeypatch.setattr(Ranks, "add", second_round)
    for rank, trainer in enumerate(trainers):
        trainer.join(Ranks(rank, 2))
        trainer.advance(0.0)
        assert trainer.step == 2 and trainer.optimizer.steps == 2
        assert torch.equal(trainer.density.views, said[0][-1] + said[1][-1])
    assert same(trainers[0].optimizer.gaussians, trainers[1].optimizer.gaussians)


def test_a_step_of_two_photos_is_two_steps_long():
    one, both = (
        Adam(Gaussians(*(torch.ones(shape) for shape in ((1, 3), (1, 3), (1, 4), (1,), (1, 1, 3))))) for _ in "ab"
    )
    rates = dict.fromkeys(("means", "log_scales", "quaternions", "opacity_logits", "sh", "sh_rest"), 0.01)
    for _ in range(2):
        one.gaussians.means.grad = torch.ones(1, 3)
        one.step(rates)
    both.gaussians.means.grad = torch.ones(1, 3)
    both.step(rates, 2)
    assert one.steps == both.steps == 2
    assert torch.allclose(one.gaussians.means, both.gaussians.means)
    for moments in ("first", "second"):
        assert torch.allclose(getattr(one, moments)["means"], getattr(both, moments)["means"], rtol=1e-4)
