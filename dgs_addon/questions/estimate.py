"""How long a run would take, and what it would reach: asked of the engine beside Blender."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...core.json_shape import boolean, number
from ..engine.process import RUN
from ..engine.question import QUIETLY, Question
from ..job.state import duration_text

#: Settings that a prediction depends on; another value makes it one of another job.
_DECIDING = (
    "photos",
    "selection",
    "max_size",
    "cameras",
    "model",
    "medium",
    "sigma",
    "sigma_minor",
    "angle",
    "psf_file",
    "blur_space",
    "max_gaussians",
    "sh_degree",
    "holdout_every",
    "effects",
    "device",
    "threads",
)
#: Arguments of a run that `estimate` takes too, each with a value.
_SHARED = (
    "--psf",
    "--blur-space",
    "--max-size",
    "--cameras",
    "--holdout-every",
    "--effects",
    "--max-gaussians",
    "--sh-degree",
    "--device",
    "--threads",
)

_SPAN = {"value": number, "low": number, "high": number}
_PRESET = {"seconds": {**_SPAN, "calibrated": boolean}, "memory_mb": {"value": number}, "psnr": (_SPAN,)}
question = Question(
    "presets", {"trials": boolean, "presets": dict.fromkeys(("draft", "balanced", "fine", "best"), _PRESET)}
)


def signature(settings: Any) -> tuple[Any, ...]:
    """The values of `scene.dgs` that its estimate depends on."""
    return tuple(getattr(settings, name) for name in _DECIDING)


def estimate_command(python: Path, arguments: Sequence[str]) -> list[str]:
    """The engine's command for a run's arguments: kind, photos, and options."""
    kept = []
    for name, value in zip(arguments[2:], arguments[3:], strict=False):
        if name in _SHARED:
            kept += [name, value]
    return [str(python), str(RUN), "estimate", arguments[1], *kept, "--json", *QUIETLY]


def sentences(answer: dict[str, Any], preset: str) -> list[tuple[str, dict[str, str]]]:
    """What to say of one preset: texts with the values that go into their braces."""
    one = answer["presets"][preset]
    seconds, memory, psnr = one["seconds"], one["memory_mb"], one["psnr"]
    span = {name: duration_text(seconds[name]) for name in ("value", "low", "high")}
    out: list[tuple[str, dict[str, str]]] = [("About {value} ({low} to {high})", span)]
    out.append(("{value} GB of memory", {"value": f"{memory['value'] / 1000:.1f}"}))
    if psnr is None:
        out.append(("Accuracy: not calibrated yet", {}))
    else:
        figures = {name: f"{psnr[name]:.1f}" for name in ("value", "low", "high")}
        out.append(("About {value} dB on held-out photos ({low} to {high})", figures))
    if answer["trials"]:
        out.append(("Longer if a shake or a focus of each photo is found", {}))
    if not seconds["calibrated"]:
        out.append(("A rough estimate: each finished run improves it", {}))
    return out
