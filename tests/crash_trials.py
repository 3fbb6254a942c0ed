"""One command, cut off once: what the folder holds when it is opened afterwards, and what asking again makes of it."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

from dgs.core.errors import DgsError
from dgs.core.sfm.child import WORKER
from dgs.core.training.trainer import Trainer
from dgs.tests.crash_commands import Case, Stage, State, alike, child, opened, run_and_exit, state
from dgs.tests.crashes import Fault, SmallDisk, arm, arm_children, child_of, counted, is_alive, unsynced

#: What a trial found: the fault came too late; the state before or after; a mixture of both, or another promise broken.
Found = Literal["done", "before", "after", "BROKEN"]
#: What nobody should find when a command has ended well.
LEFT = (".change", ".run", ".probe", ".place")
#: Seconds within which a child must end when its parent has been killed.
ORPHANED = 2.0
#: Bytes that a disk in memory gives out at a time.
PAGE = 4096


@dataclass(frozen=True)
class FaultResult:
    """What was found.

    Attributes:
        found: see `Found`; why: what is broken, by name.
        again: whether the command was asked for again, and made the right state.
    """

    found: Found
    why: str = ""
    again: bool = False


class Trials:
    """Cuts one command off, again and again.

    Args:
        stage: the prepared folders; case: the command.
    """

    def __init__(self, stage: Stage, case: Case) -> None:
        self._stage, self._case = stage, case
        stage.prepare({case.start})
        self.before = stage.state(case.start)
        stage.put(case.start)
        began = time.monotonic()
        status, said = child(lambda: case.run(stage.data, stage.folder))
        if status:
            raise AssertionError(f"{case.name} ends with {status} where nothing fails: {said}")
        #: That it takes where nothing fails.
        self.seconds = time.monotonic() - began
        self.after = alike(stage.folder)

    def steps(self) -> int:
        """How many changes of the folder the command makes; those of training depend a little on the clock."""
        self._stage.put(self._case.start)
        return counted(lambda: self._case.run(self._stage.data, self._stage.folder), self._stage.folder)

    def unsynced(self) -> str:
        """What a power cut could lose; '' for nothing."""
        stage, case = self._stage, self._case
        stage.put(case.start)

        def watched() -> int:
            faults = unsynced(lambda: case.run(stage.data, stage.folder), stage.folder)
            print("\n".join(faults), file=sys.stderr, end="", flush=True)
            return int(bool(faults))

        status, said = child(watched)
        return said if status else ""

    def at(self, fault: Fault, at: int, again: bool) -> FaultResult:
        """The `at`-th change of the folder fails; `again`: then ask for the command again, if it was not done."""
        stage, case = self._stage, self._case
        stage.put(case.start)

        def cut_off() -> int:
            arm(stage.folder, fault, at)
            return case.run(stage.data, stage.folder)

        status, said = child(cut_off)
        if fault == "kill" and status not in (0, -9) or fault == "full" and status not in (0, DgsError.exit_code):
            return FaultResult("BROKEN", f"ended with {status}: {_last(said)}")
        return self._looked_at(status, said, again)

    def child_at(self, fault: Fault, at: int, again: bool) -> FaultResult:
        """The child that looks for cameras fails at its `at`-th change of the folder; the command must say so."""
        stage, case = self._stage, self._case
        stage.put(case.start)

        def cut_off() -> int:
            arm_children(stage.folder, fault, at)
            return case.run(stage.data, stage.folder)

        status, said = child(cut_off)
        if status not in (0, DgsError.exit_code):
            return FaultResult("BROKEN", f"ended with {status}: {_last(said)}")
        if fault == "kill" and status and "ended unexpectedly (signal SIGKILL" not in said:
            return FaultResult("BROKEN", f"does not say what happened: {_last(said)}")
        return self._looked_at(status, said, again)

    def killed_in_search(self, wait: Callable[[], None], parent: bool, again: bool) -> FaultResult:
        """Signal 9 while a child looks for cameras: to that child alone, or to its parent alone.

        Args:
            wait: from the child's beginning until the kill.
        """
        stage, case = self._stage, self._case
        stage.put(case.start)
        with tempfile.TemporaryFile() as said:
            process = os.fork()
            if process == 0:
                run_and_exit(lambda: case.run(stage.data, stage.folder), said.fileno())
            searching = child_of(process, WORKER.name)
            wait()
            if searching is not None:
                with suppress(ProcessLookupError):  # it has done its work
                    os.kill(process if parent else searching, signal.SIGKILL)
            status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            said.seek(0)
            words = said.read().decode("utf-8", "replace")
        if parent and searching is not None and not _ends(searching):
            return FaultResult("BROKEN", "the child lives on without its parent")
        if not parent and status and "ended unexpectedly (signal SIGKILL" not in words:
            return FaultResult("BROKEN", f"does not say what happened: status {status}: {_last(words)}")
        return self._looked_at(status, words, again)

    def on_disk_of(self, pages: int, again: bool) -> FaultResult:
        """The folder is a real disk with so much room more than what lies in it.

        Raises:
            OSError: this user may not mount one.
        """
        stage, case = self._stage, self._case
        reads, writes = os.pipe()

        def cut_off() -> int:
            stage.put("nothing")
            stage.folder.mkdir()
            disk = SmallDisk(stage.folder)
            stage.put_into(case.start)
            disk.leave_room(pages * PAGE)
            status, said = child(lambda: case.run(stage.data, stage.folder))
            if status not in (0, DgsError.exit_code):
                outcome = FaultResult("BROKEN", f"ended with {status}: {_last(said)}")
            else:
                outcome = self._looked_at(status, said, again, disk.enlarge)
            os.write(writes, json.dumps([outcome.found, outcome.why[:3000], outcome.again]).encode())
            return 0

        status, said = child(cut_off)
        os.close(writes)
        with os.fdopen(reads) as pipe:
            answer = pipe.read()
        if not answer:
            raise OSError(f"No small disk could be mounted: {_last(said)}")
        return FaultResult(*json.loads(answer))

    def killed_from_outside(self, kill: Callable[[list[str]], int], again: bool) -> FaultResult:
        """`kill` starts the words as a process of its own, kills it, and returns its status."""
        stage, case = self._stage, self._case
        stage.put(case.start)
        return self._looked_at(kill(case.command(stage.data, stage.folder)), "", again)

    def killed_in_training(self, kill: Callable[[int, int], None], again: bool) -> FaultResult:
        """`kill` gets a child's number, and a pipe that has a byte when it begins to train."""
        stage, case = self._stage, self._case
        stage.put(case.start)
        reads, writes = os.pipe()
        usual = Trainer.advance

        def advance(trainer: Trainer, *given: Any) -> float:
            os.write(writes, b"x")
            return usual(trainer, *given)

        process = os.fork()
        if process == 0:
            Trainer.advance = advance  # type: ignore[method-assign]
            run_and_exit(lambda: case.run(stage.data, stage.folder), os.open(os.devnull, os.O_WRONLY))
        os.close(writes)
        kill(process, reads)
        os.close(reads)
        return self._looked_at(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), "", again)

    def _looked_at(
        self, status: int, said: str, again: bool, more_room: Callable[[], None] = lambda: None
    ) -> FaultResult:
        folder = self._stage.folder
        if "Traceback" in said or "A bug" in said:
            return FaultResult("BROKEN", _last(said))
        try:
            found, _ = opened(folder)
        except DgsError as error:
            return FaultResult("BROKEN", f"it cannot be opened: {error}")
        more_room()
        same = found == self.before
        if not same and alike(folder) != self.after:
            return FaultResult("BROKEN", mixed(found, alike(folder), self.before, self.after))
        if same and status == 0 and self.before != state(folder):
            return FaultResult("BROKEN", "ended well and changed nothing")
        if same and again:
            return self._asked_again()
        return FaultResult("before" if same else "done" if status == 0 else "after")

    def _asked_again(self) -> FaultResult:
        folder = self._stage.folder
        status, said = child(lambda: self._case.run(self._stage.data, folder, again=True))
        found = alike(folder)
        if status or found != self.after:
            differ = sorted(name for name in found | self.after if found.get(name) != self.after.get(name))
            return FaultResult("BROKEN", f"asked again: status {status}, other {differ}: {_last(said)}")
        left = [p.name for p in folder.iterdir() if p.name.startswith(LEFT) or p.name.endswith(".part")]
        return FaultResult("BROKEN", f"asked again: {left} are left") if left else FaultResult("before", again=True)


def _ends(process: int) -> bool:
    """Whether a process ends soon."""
    end = time.monotonic() + ORPHANED
    while is_alive(process):
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def mixed(found: State, likeness: State, before: State, after: State) -> str:
    """Which files of a folder are old, new, neither or missing."""
    kinds: dict[str, list[str]] = {"old": [], "new": [], "neither": [], "missing": []}
    for name in sorted({*found, *before}):
        if name not in found:
            kinds["missing"].append(name)
        elif name in before and found[name] == before[name]:
            kinds["old"].append(name)
        else:
            kinds["new" if after.get(name) == likeness[name] else "neither"].append(name)
    return "; ".join(f"{kind}: {', '.join(names)}" for kind, names in kinds.items() if names)


def _last(said: str) -> str:
    return " | ".join(said.strip().splitlines()[-3:])
