"""Many commands of ours at once: on this machine's cores, or on the machines of a Dask cluster.

Each is a process of its own (`child_run`), started by a Dask worker; whatever kills one is its own. Dask carries words
and how they ended, never data: folders have to be the same on all machines, as they are on a cluster's shared disk.
A worker that dies costs what it was at, which Dask gives to another one.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..core.errors import Cancelled, DgsError
from ..core.machine import cores
from ..core.progress import Progress
from .arguments import whole
from .child_run import Ended

if TYPE_CHECKING:
    from distributed import Client

#: Program of ours, which has to be at the same place on all machines.
_PROGRAM = Path(__file__).resolve().parents[1] / "run_dgs.py"
#: Seconds between two looks whether something ended, the user asked to stop, or all workers are gone.
_LOOK = 0.5
#: What workers are sent.
_AT_WORKER = Path(__file__).with_name("dgs_at_worker.py")
#: Source that a worker of this machine runs first: Ctrl-C on a terminal reaches all processes that were started there,
#: and is for the one that the user started, which asks workers to stop.
_DEAF = """import signal
def dask_setup(worker): signal.signal(signal.SIGINT, signal.SIG_IGN)
"""
#: Seconds that a cluster may take to answer.
_ANSWER = 20
#: Seconds that commands that were asked to stop may take to keep what they have.
_STOPPING = 120.0
#: Options of a command that are not handed on to what it starts.
_OWN = frozenset({"command", "workers", "scheduler", "progress", "control", "resume", "overwrite", "row"})


@dataclass(frozen=True)
class Task:
    """One command.

    Attributes:
        name: for people.
        words: behind `run_dgs.py`. Where its worker dies, the same words are asked for again.
    """

    name: str
    words: tuple[str, ...]


def add_workers(parser: argparse.ArgumentParser, what: str) -> None:
    """Who does the work; `what` names the parts that are done at the same time."""
    given = parser.add_mutually_exclusive_group()
    given.add_argument(
        "--workers",
        type=whole(1, 256),
        metavar="N",
        help=f"{what} at the same time, which share this machine's cores; one after the other if not given",
    )
    given.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help=f"{what} on all workers of a Dask cluster (tcp://HOST:8786) that see the same folders, each started "
        "with 'dask worker ADDRESS --nthreads 1'",
    )


def chosen(options: argparse.Namespace) -> Workers | None:
    """What the options ask for; None for one command after the other, in this process or by it."""
    if options.scheduler is not None:
        return Workers(address=options.scheduler)
    return None if options.workers is None else Workers(count=options.workers)


@dataclass(frozen=True)
class Workers:
    """Workers of Dask's.

    Attributes:
        count: on this machine; they end with this process.
        address: of a scheduler, where they are others'.
    """

    count: int = 0
    address: str = ""

    def threads(self, asked: int | None) -> int | None:
        """CPU threads of each command: an even share of this machine's cores unless asked otherwise."""
        return max(1, cores() // self.count) if asked is None and self.count else asked

    def run(self, tasks: Sequence[Task], progress: Progress) -> Iterator[tuple[int, Ended | None]]:
        """Runs all; yields the number of each task as it ends, and how; None where it was not begun.

        Where the user asks to stop, those that run are asked to, and no other is begun.

        Raises:
            DgsError: Dask is not installed, or the cluster does not answer.
        """
        with self._client(len(tasks)) as client:
            yield from _followed(client, tasks, progress)

    @contextmanager
    def _client(self, most: int) -> Iterator[Client]:
        distributed = _dask()
        with ExitStack() as stack:
            try:
                place = self.address or stack.enter_context(
                    distributed.LocalCluster(
                        n_workers=min(self.count, max(1, most)),
                        threads_per_worker=1,
                        memory_limit=0,  # what takes memory are the commands
                        dashboard_address=None,  # a port that nobody asked for
                        silence_logs="CRITICAL",
                        preload=[_DEAF],
                    )
                )
                client = stack.enter_context(distributed.Client(place, timeout=_ANSWER))
            except (OSError, ValueError) as error:
                raise DgsError(
                    f"The Dask scheduler '{self.address}' does not answer", "Start it: dask scheduler"
                ) from error
            yield client


def _dask() -> Any:
    """Dask's module for many processes.

    Raises:
        DgsError: it is not installed.
    """
    try:
        import distributed  # late: heavy, and only where it is asked for
    except ModuleNotFoundError as error:
        raise DgsError(
            "Working side by side needs Dask, which is not installed", "Install it: pip install distributed"
        ) from error
    return distributed


def _followed(client: Client, tasks: Sequence[Task], progress: Progress) -> Iterator[tuple[int, Ended | None]]:
    client.upload_file(str(_AT_WORKER))
    at_worker = _as_workers_call_it()
    mark = uuid.uuid4().hex
    stop = _dask().Event(f"dgs-stop-{mark}", client=client)
    futures = {
        client.submit(
            at_worker.run_words,
            str(_PROGRAM),
            str(Path.cwd()),
            task.words,
            stop.name,
            key=f"dgs-{mark}-{number}",
            pure=False,
        ): number
        for number, task in enumerate(tasks)
    }
    stopped_at = None
    said = False
    while futures:
        ended = [future for future in futures if future.done()]
        for future in ended:
            yield futures.pop(future), _end_of(future)
        if stopped_at is None and progress.cancelled():
            stopped_at = time.monotonic()
            stop.set()
            waiting = [future for future in futures if not _runs(client, future)]
            client.cancel(waiting)
            for future in waiting:
                yield futures.pop(future), None
        if stopped_at is not None and time.monotonic() - stopped_at > _STOPPING:
            return
        there = bool(client.scheduler_info()["workers"])
        if futures and not there and not said:
            progress.note("The Dask cluster has no worker at the moment; waiting for one")
        said = not there
        if futures and not ended:
            time.sleep(_LOOK)


def _as_workers_call_it() -> ModuleType:
    """Our file for workers, by the name that it has there: what is sent to them is that name."""
    name = _AT_WORKER.stem
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, _AT_WORKER)
        assert spec is not None and spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def _runs(client: Client, future: Any) -> bool:
    return any(future.key in keys for keys in client.processing().values())


def _end_of(future: Any) -> Ended | None:
    if future.cancelled():
        return None
    if future.status == "error":
        return Ended(1, " ".join(str(future.exception()).split()))
    plain: tuple[int, str, dict[str, Any]] | None = future.result()
    return None if plain is None else Ended(*plain)


def words_of(options: argparse.Namespace, leading: Sequence[str], left_out: Sequence[str] = ()) -> list[str]:
    """The command that was given, to be handed on: `leading` words, then every option that has a value.

    Args:
        left_out: names of options besides those that are never handed on.
    """
    words = list(leading)
    for name, value in vars(options).items():
        flag = f"--{name.replace('_', '-')}"
        if name in _OWN or name in left_out or value is None or value is False:
            continue
        if value is True:
            words.append(flag)
        elif isinstance(value, list | tuple):
            words += [f"{flag}={one}" for one in value]
        else:
            words.append(f"{flag}={value.absolute() if isinstance(value, Path) else value}")
    return words


def run_all(workers: Workers, tasks: Sequence[Task], progress: Progress, stage: str) -> None:
    """Runs all tasks, with their number as progress.

    Raises:
        Cancelled: the user asked to stop. DgsError: one failed; all others were run.
    """
    progress.stage(stage, len(tasks))
    failed, done = list[str](), 0
    for number, ended in workers.run(tasks, progress):
        if ended is not None and ended.status == 0:
            done += 1
            progress.advance(done)
        elif ended is not None and not progress.cancelled():
            failed.append(f"{tasks[number].name}: {ended.line}")
            progress.note(f"failed: {failed[-1]}")
    if progress.cancelled():
        raise Cancelled(f"Stopped after {done} of {len(tasks)}", "Go on with --resume")
    if failed:
        raise DgsError(f"{len(failed)} of {len(tasks)} failed, the first for this: {failed[0]}")
