"""Kills the engine (signal 9) at random moments of real jobs and says what it cost. Prints a table.

    .venv/bin/python -m tools.kill_engine [--kills 20] [--seed 0]

One set of a dozen small photos; each job runs to a random moment of its preparation or its optimization,
is killed, and is resumed to the next moment, until all kills are done; the last job runs to its end.
Blender (pip's bpy, this process) must live through all of it and say what happened each time. Lost work is
the optimization since the last checkpoint; what every start does anyway (loading, compiling) is not.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Gaussians and photos are few, so that a job takes seconds and most kills hit the optimization.
GAUSSIANS = 2000
#: How much is optimized: it has to outlast the latest moment of a kill.
PRESET = "fine"
#: Share of the kills that wait for the optimization to begin; the others come while the engine still prepares.
TRAINING = 0.7
#: Latest moment of a kill, in seconds after the engine was started; and after the optimization has begun, where
#: a checkpoint comes every 25 s.
LATEST, LATEST_TRAINING = 10.0, 40.0
#: What may be lost, in seconds.
ALLOWED = 30.0


@dataclass(frozen=True)
class Kill:
    """One kill.

    Attributes:
        after: seconds from the engine's start.
        stage: what it did then.
        step: optimization step that was reached, 0 before it.
        lost: seconds of the optimization that the resumed job does again.
        alive: whether Blender lived and said why the job had ended.
    """

    after: float
    stage: str
    step: int
    lost: float
    alive: bool


def kill_jobs(photos: Path, out: Path, kills: int, seed: int) -> tuple[list[Kill], str]:
    """Kills `kills` times; returns what happened, and the last job's phase.

    Args:
        photos: folder of `write_scene` (photos/ and model/).
        out: results' folder.
    """
    import bpy
    from dgs.dgs_addon.job import runner
    from dgs.dgs_addon.job.request import request_of

    settings = bpy.context.scene.dgs
    settings.photos, settings.out = str(photos / "photos"), str(out)
    settings.cameras, settings.model = "model", str(photos / "model")
    settings.medium, settings.sigma = "gaussian", 2.5
    settings.preset, settings.max_gaussians, settings.holdout_every = PRESET, GAUSSIANS, 4
    settings.add_when_done = False
    moments, done = random.Random(seed), []
    request = request_of("reconstruct", bpy.context.scene)
    while len(done) < kills:
        job = runner.start(request, Path(sys.executable), bpy.context.scene)
        began, training = time.monotonic(), moments.random() < TRAINING
        after = moments.uniform(0.1, LATEST_TRAINING if training else LATEST)
        while job.state.alive and training and job.state.stage != "train":
            runner.wait(0.02)
        ready = time.monotonic()
        while job.state.alive and time.monotonic() - ready < after:
            runner.wait(0.02)
        if not job.state.alive:  # it was done before its moment: begin anew
            request = request_of("reconstruct", bpy.context.scene)
            continue
        optimized = time.monotonic() - ready if training else 0.0
        done.append(_kill(job, out, time.monotonic() - began, optimized))
        print(_row(len(done), done[-1]), flush=True)
        request = _resumed(out) or request_of("reconstruct", bpy.context.scene)
    job = runner.start(_resumed(out) or request, Path(sys.executable), bpy.context.scene)
    runner.wait(300.0)
    return done, job.state.phase


def _kill(job: Any, out: Path, after: float, optimized: float) -> Kill:
    from dgs.core.twin.begun import RUN
    from dgs.dgs_addon.job import runner

    while job.worker.pid is None:  # the process is only being made
        time.sleep(0.005)
    stage, step = job.state.stage, job.state.marks[-1].step if job.state.marks else 0
    os.kill(job.worker.pid, signal.SIGKILL)
    now = time.time()
    runner.wait(10.0)
    checkpoint = out / RUN / "checkpoint.npz"
    kept = checkpoint.stat().st_mtime if checkpoint.is_file() else 0.0
    lost = min(optimized, max(0.0, now - kept))
    reported = job.state.phase == "failed" and "SIGKILL" in job.state.error
    return Kill(after, stage or "start", step, lost, reported)


def _resumed(out: Path) -> Any:
    """What the panel's Resume asks for; None if nothing can be resumed."""
    from dgs.dgs_addon.job import runner
    from dgs.dgs_addon.job.request import resumed_request

    record = runner.resumable(out)
    return None if record is None else resumed_request(record, out)


HEAD = "kill  after    stage     step   lost     Blender alive"


def _row(number: int, kill: Kill) -> str:
    return (
        f"{number:>4}  {kill.after:5.1f} s  {kill.stage:<8} {kill.step:>5}  {kill.lost:5.1f} s  "
        f"{'yes' if kill.alive else 'NO'}"
    )


def main() -> int:
    """0 if Blender lived each time and little was lost."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    import run_dgs

    run_dgs.mount_package()
    import dgs
    from dgs.tests.command_line.scene import write_scene

    dgs.register()
    print(HEAD, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        write_scene(Path(folder) / "set")
        kills, phase = kill_jobs(Path(folder) / "set", Path(folder) / "out", options.kills, options.seed)
    worst = max((kill.lost for kill in kills), default=0.0)
    print(f"\n{len(kills)} kills, at most {worst:.1f} s lost, the last job: {phase}")
    return 0 if phase == "done" and all(kill.alive and kill.lost <= ALLOWED for kill in kills) else 1


if __name__ == "__main__":
    sys.exit(main())
