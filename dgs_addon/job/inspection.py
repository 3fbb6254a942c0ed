"""What the photos show, and point spreads measured from a photo: asked of the engine beside Blender."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..engine.errand import Errand, Step
from .request import RUN


@dataclass
class Question:
    """One question to the engine, and its answer.

    Attributes:
        subject: what was asked about; another subject makes the answer one of something else.
        answer: the JSON that came back; error: what went wrong, as one line.
    """

    key: str
    errand: Errand | None = None
    subject: tuple[str, ...] = ()
    answer: dict[str, Any] = field(default_factory=dict)
    error: str = ""

    @property
    def running(self) -> bool:
        """Whether the engine is at it."""
        return self.errand is not None and self.errand.running

    def ask(self, subject: tuple[str, ...], title: str, words: Sequence[str]) -> None:
        """Starts the engine with `words`; returns at once."""
        self.subject, self.answer, self.error = subject, {}, ""
        self.errand = Errand([Step(title, list(words))])
        self.errand.start()

    def take(self) -> bool:
        """Takes in the answer; True once there is one (or an error)."""
        if self.errand is None or self.errand.running:
            return False
        self.answer, self.error = read(self.errand.lines, self.errand.status or 0, self.key)
        self.errand = None
        return True

    def stop(self) -> None:
        """Ends the engine's work, as when the add-on is switched off."""
        if self.errand is not None and self.errand.running:
            self.errand.cancel()
            self.errand.join(5.0)


effects = Question("effects")
point_spread = Question("sigma")


def inspect_words(python: Path, photos: Path, out: Path, cameras: Path | None) -> list[str]:
    """The engine's command that inspects photos; without known cameras it looks for none, which takes seconds."""
    known = ["--cameras", str(cameras)] if cameras is not None else ["--without-cameras"]
    folder = ["--out", str(out)]
    return [str(python), str(RUN), "inspect", str(photos), *folder, *known, "--json", "--progress", "none"]


def measure_words(python: Path, photo: Path, kernel: Path, linear: bool) -> list[str]:
    """The engine's command that measures a point spread."""
    space = [] if linear else ["--srgb"]
    out = ["--out", str(kernel)]
    return [str(python), str(RUN), "measure-psf", str(photo), *out, *space, "--json", "--progress", "none"]


def read(lines: Sequence[str], status: int, key: str) -> tuple[dict[str, Any], str]:
    """The JSON object with `key` among the engine's words, or what went wrong."""
    text = "\n".join(line for line in lines if not line.startswith("$"))
    start = text.find("{")
    if status == 0 and start >= 0:
        try:
            found, _ = json.JSONDecoder().raw_decode(text[start:])
        except ValueError:
            found = None
        if isinstance(found, dict) and key in found:
            return found, ""
    said = [line for line in text.splitlines() if line.strip()]
    return {}, said[-1] if said else f"The engine ended with status {status}"


def sentences(answer: dict[str, Any]) -> list[tuple[str, bool]]:
    """(one line, whether it is needed) of every effect that could be measured, the needed ones first."""
    rows = [e for e in answer.get("effects", ()) if e["estimate"]["value"] is not None]
    rows.sort(key=lambda e: not e["needed"])
    return [(f"{e['name'].replace('_', ' ').capitalize()}: {e['evidence']}", bool(e["needed"])) for e in rows]
