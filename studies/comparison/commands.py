"""Studies that run our own commands one after the other, and end where one of them fails."""

from __future__ import annotations

from collections.abc import Callable

#: Runs the words of one command and returns its exit status.
Run = Callable[[list[str]], int]


class Failed(Exception):
    """A command ended with this exit status; it has said why."""


def checked(run: Run) -> Callable[..., None]:
    """Names every command before it runs, and raises `Failed` where it fails."""

    def command(*words: object) -> None:
        print("run_dgs.py " + " ".join(map(str, words)), flush=True)
        status = run([str(word) for word in words])
        if status:
            raise Failed(status)

    return command
