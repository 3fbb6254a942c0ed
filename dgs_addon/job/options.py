"""What a job is asked to do besides its photos and its folder: checked values, and the arguments that they make.

A job's file may come from anybody. So it holds no command line but values by the names of this table, each with a type
and a range, and every argument is built here. Knows no Blender.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...core.effects.choices import effect_items
from ...core.json_shape import number
from ...core.names import fault_of, shown

Value = bool | int | float | str
Options = dict[str, Value]

#: Kinds of jobs that have options, and a checkpoint or cameras to go on from.
RESUMABLE = ("cameras", "reconstruct")
_LARGEST = 2**31 - 1
_FIGURE = r"\d+(\.\d+)?(e[+-]?\d+)?"
_GAUSSIAN = re.compile(rf"gaussian:{_FIGURE}(,{_FIGURE},-?{_FIGURE})?")
#: How the panel has always ended a job's arguments; the job's file says nothing of it any more.
_STEERED = ("--progress", "json", "--control")


def absolute_path(value: object) -> bool:
    """An absolute path, which no program takes for an option."""
    return isinstance(value, str) and os.path.isabs(value) and not fault_of(value)


def _point_spread(value: object) -> bool:
    if not isinstance(value, str):
        return False
    kind, _, rest = value.partition(":")
    if kind == "file":
        return absolute_path(rest)
    return value in ("none", "auto", "auto-each") or _GAUSSIAN.fullmatch(value) is not None


def _seconds(value: object) -> bool:
    return number(value) and 0.0 < float(value) <= _LARGEST  # type: ignore[arg-type]


def _whole(low: int, high: int = _LARGEST) -> Callable[[object], bool]:
    def whole_number(value: object) -> bool:
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high

    return whole_number


def _one_of(*names: str) -> Callable[[object], bool]:
    return lambda value: isinstance(value, str) and value in names


def _switch(value: object) -> bool:
    return value is True


@dataclass(frozen=True)
class Option:
    """One value of a job, and its argument.

    Attributes:
        flag: of the engine's command line.
        good: whether a value is of the right type and range.
        read: the value in an argument of a job's file of an earlier version; raises ValueError.
        write: the argument's text; '' for a flag without one.
        only: the kind of job that has it, or '' for all of them.
    """

    flag: str
    good: Callable[[object], bool]
    read: Callable[[str], Value] = str
    write: Callable[[Value], str] = str
    only: str = "reconstruct"


#: Every value of a job, in the order of the arguments.
OPTIONS: dict[str, Option] = {
    "psf": Option("--psf", _point_spread, only=""),
    "blur_space": Option("--blur-space", _one_of("srgb", "linear"), only=""),
    "masks": Option("--masks", absolute_path, only=""),
    "background": Option("--background", _one_of("auto", "none", "white", "black")),
    "max_size": Option("--max-size", _whole(1), int, only=""),
    "frames": Option("--frames", _whole(1), int, only=""),
    "cameras": Option("--cameras", absolute_path),
    "preset": Option("--preset", _one_of("draft", "balanced", "fine", "best")),
    "holdout_every": Option("--holdout-every", _whole(0), int),
    "seed": Option("--seed", _whole(0), int),
    "max_gaussians": Option("--max-gaussians", _whole(1), int),
    "effects": Option("--effects", _one_of(*(item[0] for item in effect_items()))),
    "adjust_cameras": Option("--adjust-cameras", _one_of("auto", "never", "always")),
    "refine_cameras": Option("--refine-cameras", _switch, write=lambda _: ""),
    "time_limit": Option("--time-limit", _seconds, lambda text: float(text.removesuffix("s")), lambda v: f"{v:.1f}s"),
    "sh_degree": Option("--sh-degree", _whole(0, 3), int),
    "truth": Option("--truth", absolute_path),
    "snapshots": Option("--snapshots", _switch, write=lambda _: ""),
    "device": Option("--device", _one_of("auto", "cpu", "gpu"), only=""),
    "threads": Option("--threads", _whole(1), int, only=""),
}
_BY_FLAG = {option.flag: name for name, option in OPTIONS.items()}


def check_options(kind: str, options: Mapping[str, object]) -> None:
    """Checks every value of a job.

    Raises:
        ValueError: a name that no such job has, or a value that is of another type or out of range.
    """
    for name, value in options.items():
        option = OPTIONS.get(name)
        if option is None or option.only not in ("", kind):
            raise ValueError(f"it asks for '{shown(name)[:40]}', which is nothing that this job does")
        if not option.good(value):
            raise ValueError(f"{name} cannot be {shown(repr(value))[:60]}")


def job_arguments(kind: str, source: Path, out: Path, options: Mapping[str, Value]) -> list[str]:
    """The engine's command line for a job: the button says the command, the user the folder.

    Args:
        kind: 'cameras' or 'reconstruct'.
        source: folder of photos, list of them, or movie; absolute.
        out: folder for the results; absolute.
        options: as `check_options` wants them.
    """
    arguments = [kind, str(source), "--out", str(out)]
    for name, option in OPTIONS.items():
        if name in options:
            text = option.write(options[name])
            arguments += [option.flag, text] if text else [option.flag]
    return [*arguments, *_STEERED]


def options_of(arguments: list[str]) -> Options:
    """The values in the command line of an earlier version's job; its command and its folder do not count.

    Raises:
        ValueError: there is an argument that the panel never gave, or one without a value.
    """
    options: Options = {}
    rest = iter(arguments[2:])
    for flag in rest:
        name = _BY_FLAG.get(flag)
        if name is not None and not OPTIONS[name].write(1):
            options[name] = True
        elif name is not None or flag in ("--out", "--progress"):
            text = next(rest, "")
            if name is not None:
                options[name] = OPTIONS[name].read(text)
        elif flag not in ("--control", "--resume"):
            raise ValueError(f"it asks for '{shown(flag)[:40]}', which is nothing that the panel asks for")
    return options
