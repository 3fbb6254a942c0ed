"""A run of several processes that train one twin together, on one machine or many; alone where only one was started.

Every rank reads the photos and makes the training's views by itself, from files of its own; what they train from is
then compared. Rank 0 writes the results; the others have a folder in the system's temporary one, and end with the
training.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from ..errors import DgsError
from ..machine import cores
from ..progress import Progress, Silent
from ..run_settings import RunSettings
from ..training.ranks import (
    OtherRankFinishes,
    RankLost,
    Ranks,
    RanksDiffer,
    join_ranks,
    leave_ranks,
    local_count,
    started_together,
)
from .reconstruct import FinishedRun
from .reconstruct import reconstruct as stages
from .timing import MakeTiming, Untimed


def reconstruct(
    run: RunSettings, progress: Progress, began: float | None = None, timing_on: MakeTiming = Untimed
) -> FinishedRun | None:
    """As `pipeline.reconstruct.reconstruct`; with several ranks, rank 0 returns the finished run, the others None.

    Raises:
        DgsError: as there. SystemExit: rank 0 says what is wrong.
    """
    if not started_together():
        return stages(run, progress, began, timing_on)
    _check(run)
    run = replace(run, threads=run.threads or max(1, cores() // local_count()))
    ranks = join_ranks()
    try:
        if ranks.rank == 0:
            return stages(run, progress, began, timing_on, ranks)
        _help(run, progress, began, ranks)
        return None
    finally:
        leave_ranks()


def _help(run: RunSettings, progress: Progress, began: float | None, ranks: Ranks) -> None:
    """What every rank but the first does."""
    with tempfile.TemporaryDirectory(prefix="dgs-rank-") as folder:
        own = replace(run, out=Path(folder) / "run", resume=False, keep_cameras=False, snapshots=False)
        try:
            stages(own, _Quiet(progress), began, Untimed, ranks)
        except OtherRankFinishes:
            return
        except (RankLost, RanksDiffer) as error:
            raise SystemExit(error.exit_code) from error


def _check(run: RunSettings) -> None:
    """What several ranks cannot do, before they meet."""
    wrong = {
        "look for cameras": run.cameras.given is None,
        "move cameras": run.cameras.refine,
        "keep a time limit": run.time_limit is not None,
    }
    for what, asked in wrong.items():
        if asked:
            way = "Find the cameras first, with 'cameras', and give them with --cameras"
            raise DgsError(f"Several ranks do not {what}", way if "cameras" in what else "Leave out --time-limit")


class _Quiet(Silent):
    """Only asks whether to stop."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        return self._progress.cancelled()
