"""Pulling the plug: whatever fails in whichever step of a command, its folder is as before or as after.

A few steps of every command; `make crash-test` tries them all.
"""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from dgs.core import lock, transaction
from dgs.core.transaction import CONTENT, FolderChange
from dgs.tests.crash_commands import CASES, Case, Stage, as_usual, warm_up
from dgs.tests.crash_trials import Trials
from dgs.tests.crashes import can_mount

#: Steps of each command that are killed; their places are spread over the command.
KILLS = 3
#: Those that say something of their own; Blender's scene has its test in tests/blender.
LONG = ("blend", "next-view again", "resume a killed run")
QUICK = [case for case in CASES if not case.search and not case.name.startswith(LONG)]


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Folders from which the commands start; in memory, where there is a disk in memory."""
    shared = Path("/dev/shm")
    work = (shared if os.access(shared, os.W_OK) else tmp_path_factory.mktemp("crashes")) / f"dgs-test-{os.getpid()}"
    with as_usual():
        warm_up()
        yield Stage(work)
        shutil.rmtree(work, ignore_errors=True)


@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.name)
def test_cut_off_anywhere_a_folder_is_as_before_or_as_after(stage: Stage, case: Case) -> None:
    trials = Trials(stage, case)
    steps = trials.steps()
    found = []
    for part in range(KILLS):
        at = 1 + (2 * part + 1) * steps // (2 * KILLS)
        found.append(trials.at("kill", at, again=part == KILLS // 2))
    found.append(trials.at("full", 1 + steps // 8, again=False))
    if can_mount():
        found.append(trials.on_disk_of(3, again=True))
    assert not [outcome.why for outcome in found if outcome.found == "BROKEN"]
    assert "before" in {outcome.found for outcome in found}
    assert not trials.unsynced(), "something has its place before it is on the disk"


def test_a_search_for_cameras_that_is_killed_leaves_nothing_and_is_said(stage: Stage) -> None:
    trials = Trials(stage, case_of("cameras from photos"))
    for parent in (False, True):
        found = trials.killed_in_search(lambda: time.sleep(0.3 * trials.seconds), parent, again=parent)
        assert found.found == "before", found.why


def place_one_by_one(change: FolderChange) -> None:
    """No journal: each file is put in its place as it comes."""
    for name in change._placed:
        target = change._folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            shutil.rmtree(target)
        os.replace(change._next / CONTENT / name, target)
    for name in change._removed:
        target = change._folder / name
        shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)


def case_of(name: str) -> Case:
    return next(case for case in CASES if case.name == name)


def test_a_change_without_its_journal_is_found_out(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FolderChange, "commit", place_one_by_one)
    trials = Trials(stage, case_of("rollback"))
    assert "BROKEN" in {trials.at("kill", at, again=False).found for at in range(1, trials.steps())}


def test_a_recovery_that_gives_up_is_found_out(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    trials = Trials(stage, case_of("rollback"))
    steps = trials.steps()

    def gives_up(folder: Path) -> None:
        for name in (transaction.NEXT, transaction.COMMIT):
            shutil.rmtree(folder / name, ignore_errors=True)

    monkeypatch.setattr(lock, "recover", gives_up)
    assert "BROKEN" in {trials.at("kill", at, again=False).found for at in range(steps // 3, steps)}


@pytest.mark.parametrize("missing", ["sync_folder", "_sync_tree"])
def test_a_change_that_is_not_synced_is_found_out(stage: Stage, missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    trials = Trials(stage, case_of("render over pictures"))
    assert not trials.unsynced()
    monkeypatch.setattr(transaction, missing, lambda folder: None)
    assert ("on the disk" if missing == "_sync_tree" else "was not synced") in trials.unsynced()
