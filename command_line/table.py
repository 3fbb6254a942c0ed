"""Every command: its name, what it is for, its file, and whether it needs the engine's packages.

A command is one file, `NAME_command.py` with '_' for '-', which holds `add_arguments(parser)` and
`NAME_command(options, progress)`, and one line here. Nothing but this table lists the commands. It needs the standard
library only: `run_dgs.py` reads it in a Python that may lack everything else.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .progress_choice import Reporting

Handler = Callable[[argparse.Namespace, "Reporting"], int]


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        name: as it is typed.
        help: its line in the list of commands.
        needs_engine: whether it needs torch and the rest of the engine's packages, which Blender's own Python lacks;
            if not, it needs Blender's module, whose own output is kept off the terminal.
        saves: whether there is anything to save when it is asked to stop.
    """

    name: str
    help: str
    needs_engine: bool = True
    saves: bool = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Adds the command's description and arguments; reads its file."""
        self._file().add_arguments(parser)

    def handler(self) -> Handler:
        """The function that runs it: takes the parsed arguments and a progress, returns the exit status."""
        found: Handler = getattr(self._file(), self._stem)
        return found

    @property
    def _stem(self) -> str:
        return f"{self.name.replace('-', '_')}_command"

    def _file(self) -> Any:
        return importlib.import_module(f".{self._stem}", __package__)


#: In the order of `--help`.
COMMANDS = (
    Command("reconstruct", "photos in, sharp twin out"),
    Command("batch", "a twin of each of several sets of photos"),
    Command("cameras", "only find the cameras"),
    Command("render", "images of a twin"),
    Command("doctor", "check this machine"),
    Command("stress", "hard cases on this machine"),
    Command("blend", "a .blend of a twin", needs_engine=False),
    Command("synthesize", "make a test set with Blender", needs_engine=False),
    Command("compare", "ways to a sharp twin, scored against the truth"),
    Command("inspect", "which effects the photos show"),
    Command("estimate", "what a run would take and reach", saves=False),
    Command("tradeoff", "what each knob costs in time and brings"),
    Command("measure-psf", "the point spread from a calibration photo"),
    Command("measure-glass", "distance and angle of frosted glass from calibration photos", saves=False),
    Command("next-view", "which photo to take next"),
    Command("update", "new photos into a twin"),
    Command("measure", "lengths, widths, angles and areas on a twin, with error bars", saves=False),
    Command("board", "a marker board to print, that gives a twin its scale", saves=False),
    Command("mesh", "a twin's surface as a mesh"),
    Command("change", "what has changed between two twins, with error bars"),
    Command("serve", "draw twins for another program", saves=False),
)


def command_of(arguments: list[str]) -> Command | None:
    """The command that the arguments name, or None."""
    return next((command for command in COMMANDS if command.name in arguments[:1]), None)
