"""A question to the engine, and its answer as JSON. Knows no Blender."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ...core.files import parse_json
from ...core.json_shape import Shape, check_shape
from .errand import Errand, ErrandStep

#: How a question is put: its answer is all that is printed, and nobody goes on with it when Blender ends.
QUIETLY = ("--progress", "none", "--control")
#: Seconds that an engine that was ended may take to go.
_FAREWELL = 5.0


@dataclass
class Question:
    """One question to the engine, and its answer.

    Attributes:
        key: that the answer must have.
        shape: what else is read of it, see `core.json_shape`.
        subject: what was asked about; another subject makes the answer one of something else.
        answer: the JSON object that came back; {} if none did.
        error: what went wrong, in one line; '' if nothing did.
    """

    key: str
    shape: Shape = field(default_factory=dict)
    errand: Errand | None = None
    subject: tuple[Any, ...] = ()
    answer: dict[str, Any] = field(default_factory=dict)
    error: str = ""

    @property
    def running(self) -> bool:
        """Whether the engine is at it."""
        return self.errand is not None and self.errand.running

    def ask(self, subject: tuple[Any, ...], title: str, command: Sequence[str]) -> None:
        """Starts the engine; returns at once."""
        self.subject, self.answer, self.error = subject, {}, ""
        self.errand = Errand([ErrandStep(title, list(command))])
        self.errand.start()

    def take(self) -> bool:
        """Takes in the answer; True once there is one (or an error)."""
        if self.errand is None or self.errand.running:
            return False
        self.answer, self.error = read_answer(self.errand.lines, self.errand.status or 0, self.key)
        try:
            check_shape(self.answer, self.shape if self.answer else {})
        except ValueError as error:
            self.answer, self.error = {}, f"The engine's answer is not understood: {error}"
        self.errand = None
        return True

    def stop(self) -> None:
        """Ends the engine's work, as when the add-on is switched off."""
        if self.errand is not None and self.errand.running:
            self.errand.cancel()
            self.errand.join(_FAREWELL)


def read_answer(lines: Sequence[str], status: int, key: str) -> tuple[dict[str, Any], str]:
    """The JSON object with `key` among the lines that the engine wrote, or what went wrong.

    Args:
        lines: of the command: '$ COMMAND' first, then its output, the object over one line or several.
        status: its exit status.
        key: that the object must have.

    Returns:
        (object, '') or ({}, the engine's last line).
    """
    said = [line for line in lines if line.strip() and not line.startswith("$")]
    for number, line in enumerate(said):
        found = _object("\n".join(said[number:])) if line.startswith("{") else None
        if status == 0 and found is not None and key in found:
            return found, ""
    return {}, said[-1] if said else f"The engine ended with status {status}"


def _object(text: str) -> dict[str, Any] | None:
    """The JSON object that `text` begins with, or None."""
    try:
        _, end = json.JSONDecoder().raw_decode(text)
        found = parse_json(text[:end].encode("utf-8", "replace"))
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
