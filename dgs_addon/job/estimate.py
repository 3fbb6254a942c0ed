"""What the engine says a run would take, asked beside Blender. Knows no Blender but its settings."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..engine.errand import Errand, Step

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
    "--max-gaussians",
    "--sh-degree",
    "--device",
    "--threads",
)

_errand: Errand | None = None
_asked: tuple[Any, ...] = ()
_told: dict[str, Any] = {}
_error = ""


def signature(settings: Any) -> tuple[Any, ...]:
    """Of the job that `scene.dgs` describes."""
    return tuple(getattr(settings, name) for name in _DECIDING)


def command(python: Path, script: Path, arguments: Sequence[str]) -> list[str]:
    """The engine's command for a run's arguments: kind, photos, and options."""
    kept = []
    for name, value in zip(arguments[2:], arguments[3:], strict=False):
        if name in _SHARED:
            kept += [name, value]
    return [str(python), str(script), "estimate", arguments[1], *kept, "--json", "--progress", "none"]


def start(asked: tuple[Any, ...], words: Sequence[str]) -> None:
    """Asks; returns at once.

    Args:
        asked: `signature` of the settings that `words`, the command, were made of.
    """
    global _errand, _asked, _told, _error
    _asked, _told, _error = asked, {}, ""
    _errand = Errand([Step("Estimating", list(words))])
    _errand.start()


def running() -> bool:
    """Whether the engine is thinking."""
    return _errand is not None and _errand.running


def stop() -> None:
    """Ends the engine's thinking, as when the add-on is switched off."""
    if _errand is not None and _errand.running:
        _errand.cancel()
        _errand.join(5.0)


def take() -> bool:
    """Takes in the answer; True once there is one (or an error)."""
    global _errand, _told, _error
    if _errand is None or _errand.running:
        return False
    _told, _error = read(_errand.lines, _errand.status or 0)
    _errand = None
    return True


def read(lines: Sequence[str], status: int) -> tuple[dict[str, Any], str]:
    """The answer among the engine's words, or what went wrong."""
    for line in reversed(list(lines)):
        if line.startswith("{"):
            try:
                found = json.loads(line)
            except ValueError:
                continue
            if isinstance(found, dict) and "presets" in found:
                return found, ""
    said = [line for line in lines if not line.startswith("$")]
    return {}, said[-1] if said else f"The engine ended with status {status}"


def known(settings: Any) -> tuple[dict[str, Any], str]:
    """(answer, error) for the job that the settings describe now; empty where nobody asked."""
    if _asked != signature(settings):
        return {}, ""
    return _told, _error


def sentences(told: dict[str, Any], preset: str) -> list[tuple[str, dict[str, str]]]:
    """What to say of one preset: texts with the values that go into their braces."""
    one = told["presets"][preset]
    seconds, memory, psnr = one["seconds"], one["memory_mb"], one["psnr"]
    span = {name: _duration(seconds[name]) for name in ("value", "low", "high")}
    out: list[tuple[str, dict[str, str]]] = [("About {value} ({low} to {high})", span)]
    out.append(("{value} GB of memory", {"value": f"{memory['value'] / 1000:.1f}"}))
    if psnr is None:
        out.append(("Accuracy: not calibrated yet", {}))
    else:
        figures = {name: f"{psnr[name]:.1f}" for name in ("value", "low", "high")}
        out.append(("About {value} dB on held-out photos ({low} to {high})", figures))
    if not seconds["calibrated"]:
        out.append(("Rough: each finished run makes this better", {}))
    return out


def _duration(seconds: float) -> str:
    from .state import duration_text

    return duration_text(seconds)
