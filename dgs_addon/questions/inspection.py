"""What the photos show, and point spreads measured from a photo: asked of the engine beside Blender."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.effects.registry import switches
from ...core.json_shape import anything, boolean, number, sentence, text
from ..engine.process import RUN
from ..engine.question import QUIETLY, Question

#: Evidence that the medium of step 3 is for, and evidence that the usual choice of other effects is for.
_BLUR, _USUAL = "blur", ("exposure", "white_balance")

effects = Question(
    "effects", {"effects": [{"name": text, "needed": boolean, "evidence": sentence, "estimate": {"value": anything}}]}
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


@dataclass(frozen=True)
class Finding:
    """What the photos show of one effect.

    Attributes:
        name: as the engine calls the evidence.
        text: one line.
        needed: whether it is large enough to be modelled.
        value: its size.
    """

    name: str
    text: str
    needed: bool
    value: Any


def findings(answer: dict[str, Any]) -> list[Finding]:
    """Every effect that could be measured, the needed ones first."""
    rows = [e for e in answer.get("effects", ()) if e["estimate"]["value"] is not None]
    rows.sort(key=lambda e: not e["needed"])
    return [
        Finding(
            e["name"],
            f"{e['name'].replace('_', ' ').capitalize()}: {e['evidence']}",
            bool(e["needed"]),
            e["estimate"]["value"],
        )
        for e in rows
    ]


def sentences(answer: dict[str, Any]) -> list[tuple[str, bool]]:
    """(one line, whether it is needed) of every effect that could be measured, the needed ones first."""
    return [(found.text, found.needed) for found in findings(answer)]


def can_be_modelled(found: Finding) -> bool:
    """Whether there is a setting for it; noise, for one, has none."""
    return found.name == _BLUR or bool(_effects_against([found]))


def is_modelled(found: Finding, settings: Any) -> bool:
    """Whether the settings of `scene.dgs` take it into account, or let the engine decide."""
    if found.name == _BLUR:
        return bool(settings.medium != "none")
    chosen = settings.effects
    return chosen in ("auto", "all", *_effects_against([found])) or (chosen == "usual" and found.name in _USUAL)


def use(answer: dict[str, Any], settings: Any) -> None:
    """Sets step 3 to what was found: the blur's own width, and where other effects are needed, trials that decide.

    An effect is not forced: evidence may be a false alarm, and a trial costs less than a twin that was spoilt.
    """
    needed = [found for found in findings(answer) if found.needed]
    blur = next((found for found in needed if found.name == _BLUR), None)
    settings.medium = "none" if blur is None else "gaussian"
    if blur is not None:
        settings.sigma = float(blur.value)
    tried = [found for found in needed if found.name not in (_BLUR, *_USUAL)]
    settings.effects = "auto" if _effects_against(tried) else "usual"


def _effects_against(found: Sequence[Finding]) -> list[str]:
    """The switches that model any of these findings."""
    names = {one.name for one in found}
    return [name for name, switch in switches().items() if names & set(switch.speakers)]
