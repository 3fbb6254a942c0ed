"""From where to take the next photos: asked of the engine beside Blender. Its answer lies in the twin's folder, too."""

from __future__ import annotations

from pathlib import Path

from ...core.json_shape import anything
from ..engine.process import RUN
from ..engine.question import QUIETLY, Question

question = Question("views", {"views": [{"*": anything}]})


def next_views_command(python: Path, twin: Path, count: int) -> list[str]:
    """The engine's command that looks for `count` views around what the photos of a twin's folder show."""
    return [str(python), str(RUN), "next-view", str(twin), "--count", str(count), "--json", *QUIETLY]
