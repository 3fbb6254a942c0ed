"""Whether what came out of a JSON file has the types that are read from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

#: Characters of a path, and bytes of one file's name in it, that operating systems take.
_LONGEST_PATH, _LONGEST_NAME = 4096, 255
#: How a value must be: see `check_shape`.
Shape = Any


def number(value: object) -> bool:
    """A finite number."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) < 2**1000  # (a float holds it)
    return isinstance(value, float) and math.isfinite(value)


def count(value: object) -> bool:
    """A whole number from 0, written as one."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53


def positive(value: object) -> bool:
    """A whole number from 1, written as one."""
    return count(value) and value != 0


def truth(value: object) -> bool:
    """True or false."""
    return isinstance(value, bool)


def any_text(value: object) -> bool:
    """A text of any length, such as a file inside another one."""
    return isinstance(value, str)


def text(value: object) -> bool:
    """A text that could be a path: longer ones are no file's, on any system."""
    if not isinstance(value, str) or "\0" in value or len(value) > _LONGEST_PATH:
        return False
    return all(len(part.encode("utf-8", "replace")) <= _LONGEST_NAME for part in value.split("/"))


def sentence(value: object) -> bool:
    """A text that is read, not opened: of any length, as a reason may be longer than a file's name."""
    return isinstance(value, str) and "\0" not in value


def boolean(value: object) -> bool:
    """True or false."""
    return isinstance(value, bool)


def anything(_value: object) -> bool:
    """Whatever it is."""
    return True


def check_shape(value: Any, shape: Shape, where: str = "") -> None:
    """Checks the parts of a value that are read; others may be there.

    Args:
        value: out of a JSON file.
        shape: a predicate of this module; [shape] for a list of such; {'key': shape, 'other?': shape} for an object, in
            which keys with a question mark may be missing, and '*' stands for every key that is not named;
            (shape,) for such a value or null; a frozenset of the texts that are allowed.
        where: what the message calls the value.

    Raises:
        ValueError: it says what is not as it should be: "frames[2].w is no number".
    """
    if isinstance(shape, dict):
        _check_object(value, shape, where)
    elif isinstance(shape, list):
        if not isinstance(value, list):
            raise ValueError(f"{where or 'it'} is no list")
        for index, item in enumerate(value):
            check_shape(item, shape[0], f"{where}[{index}]")
    elif isinstance(shape, tuple):
        if value is not None:
            check_shape(value, shape[0], where)
    elif isinstance(shape, frozenset):
        if not isinstance(value, str) or value not in shape:
            raise ValueError(f"{where or 'it'} is none of {', '.join(sorted(shape))}")
    elif not shape(value):
        raise ValueError(f"{where or 'it'} is no {_called(shape)}")


def _check_object(value: Any, shape: dict[str, Shape], where: str) -> None:
    if not isinstance(value, dict):
        raise ValueError(f"{where or 'it'} is no object")
    dot = f"{where}." if where else ""
    named = {key.rstrip("?") for key in shape if key != "*"}
    for key, inner in shape.items():
        name = key.rstrip("?")
        if key == "*":
            for other in value.keys() - named:
                check_shape(value[other], inner, dot + other[:40])
        elif name in value:
            check_shape(value[name], inner, dot + name)
        elif not key.endswith("?"):
            raise ValueError(f"{dot}{name} is missing")


def _called(predicate: Callable[[object], bool]) -> str:
    return predicate.__name__.strip("_").replace("_", " ")
