"""Progress as bars with the time left, on a terminal."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from .interruption import Interruption
from .time_left import TimeLeft

#: What is drawn over time, and what the bar itself says already.
ACCURACY, HIDDEN = "heldout_psnr", ("step", "seconds")
#: The latest values that are drawn, and what they are drawn with.
_LATEST, _LEVELS = 16, "▁▂▃▄▅▆▇█"


def curve(values: Sequence[float]) -> str:
    """The latest values as a line of blocks, the lowest and the highest of all of them at its ends."""
    low, span = min(values), max(max(values) - min(values), 1e-9)
    return "".join(_LEVELS[min(7, int(8 * (value - low) / span))] for value in values[-_LATEST:])


class TimeLeftColumn(ProgressColumn):
    """The time left as minutes and seconds, counted down between two reports; nothing where nobody can say."""

    max_refresh = 0.5

    def render(self, task: Task) -> Text:
        """The text of one bar."""
        end = task.fields["end"]
        if end is None or task.finished:
            return Text("")
        minutes, seconds = divmod(max(0, round(end - time.monotonic())), 60)
        return Text(f"{minutes}:{seconds:02d} left", style="progress.remaining")


class Bars:
    """One bar per stage, on stderr; results go to stdout."""

    def __init__(self, interruption: Interruption) -> None:
        self._interruption = interruption
        self._console = Console(stderr=True, highlight=False)
        # Four refreshes a second: bars must not take time from the work on two cores.
        self._bars = Progress(
            SpinnerColumn(finished_text="[green]✓"),
            TextColumn("{task.description:<9}"),
            BarColumn(bar_width=28),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeLeftColumn(),
            TextColumn("[dim]{task.fields[figures]}"),
            console=self._console,
            refresh_per_second=4,
        )
        self._task: TaskID | None = None
        self._accuracies: list[float] = []
        self._left = TimeLeft()

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins; `total` steps if they can be counted."""
        self._complete()
        self._accuracies = []
        self._task = self._bars.add_task(escape(name), total=total, figures="", end=None)
        self._left.begin(total)

    def advance(self, done: int, **figures: float) -> None:
        """So many steps of the stage are done; figures worth showing."""
        if self._task is None:
            return
        accuracy = figures.pop(ACCURACY, None)
        if accuracy is not None:
            self._accuracies.append(accuracy)
        shown = {key: value for key, value in figures.items() if key not in HIDDEN}
        words = [f"{key.replace('_', ' ')} {value:.4g}" for key, value in shown.items()]
        if self._accuracies:
            words.append(f"held out {curve(self._accuracies)} {self._accuracies[-1]:.2f} dB")
        left = self._left.after(done)
        end = None if left is None else time.monotonic() + left
        self._bars.update(self._task, completed=done, figures="  ".join(words), end=end)

    def note(self, text: str) -> None:
        """Something the user should read, in one line."""
        self._bars.console.print(f"[yellow]•[/] {escape(text)}")

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        return self._interruption.asked

    def finished(self, result: dict[str, object]) -> None:
        """The work is done: the last words."""
        self._complete()
        self._bars.stop()
        table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
        for key, value in result.items():
            if value is not None:
                table.add_row(f"[bold]{escape(key)}", escape(str(value)))
        # Paths are never wrapped: a terminal cannot open half a path.
        Console(highlight=False, soft_wrap=True).print(table)

    def failed(self, line: str, status: int) -> None:
        """The work ended with an error: what and the way out."""
        self._bars.stop()

    def _complete(self) -> None:
        if self._task is None:
            return
        task = next(t for t in self._bars.tasks if t.id == self._task)
        total = task.total if task.total is not None else max(1.0, task.completed)
        self._bars.update(self._task, total=total, completed=total)
        self._task = None
