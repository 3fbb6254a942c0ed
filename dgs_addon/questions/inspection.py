"""What the photos show, and point spreads measured from a photo: asked of the engine beside Blender."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...core.json_shape import anything, boolean, number, text
from ..engine.process import RUN
from ..engine.question import QUIETLY, Question

effects = Question(
    "effects", {"effects": [{"name": text, "needed": boolean, "evidence": text, "estimate": {"value": anything}}]}
)
point_spread = Question("sigma", {"sigma": number, "sigma_uncertainty": number})


def inspect_command(python: Path, photos: Path, out: Path, cameras: Path | None, overwrite: bool = False) -> list[str]:
    """The engine's command that inspects photos; without cameras it takes seconds."""
    given = ["--cameras", str(cameras)] if cameras is not None else ["--without-cameras"]
    folder = ["--out", str(out), *(["--overwrite"] if overwrite else [])]
    return [str(python), str(RUN), "inspect", str(photos), *folder, *given, "--json", *QUIETLY]


def measure_command(python: Path, photo: Path, kernel: Path, linear: bool, overwrite: bool = False) -> list[str]:
    """The engine's command that measures a point spread."""
    space = [] if linear else ["--srgb"]
    out = ["--out", str(kernel), *(["--overwrite"] if overwrite else [])]
    return [str(python), str(RUN), "measure-psf", str(photo), *out, *space, "--json", *QUIETLY]


def sentences(answer: dict[str, Any]) -> list[tuple[str, bool]]:
    """(one line, whether it is needed) of every effect that could be measured, the needed ones first."""
    rows = [e for e in answer.get("effects", ()) if e["estimate"]["value"] is not None]
    rows.sort(key=lambda e: not e["needed"])
    return [(f"{e['name'].replace('_', ' ').capitalize()}: {e['evidence']}", bool(e["needed"])) for e in rows]
