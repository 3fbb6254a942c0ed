"""What is asked for, and what was decided about one effect, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...effects.registry import switches
from ...errors import DgsError


@dataclass(frozen=True)
class Decision:
    """One effect's line in the report.

    Attributes:
        name: of the effect.
        on: whether it is simulated.
        why: one sentence.
        evidence: what the inspection found (`Evidence.plain`), or None where it was not asked.
        gain_db, gain_error_db: on photos held out of a short training: mean of the paired differences, and its
            standard error; None without an ablation.
        seconds: what inspection and ablation of it took.
        parameters: what is simulated, for effects that are on.
    """

    name: str
    on: bool
    why: str
    evidence: dict[str, Any] | None = None
    gain_db: float | None = None
    gain_error_db: float | None = None
    seconds: float = 0.0
    parameters: dict[str, Any] | None = None

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "on": self.on,
            "why": self.why,
            "evidence": self.evidence,
            "gain_db": self.gain_db,
            "gain_error_db": self.gain_error_db,
            "seconds": round(self.seconds, 3),
            "parameters": self.parameters,
        }


def parse_effects(text: str) -> tuple[str, tuple[str, ...]]:
    """'usual', 'auto', 'none', 'all', or names with commas -> (mode, forced names).

    `auto,haze` decides by the photos but has haze on; `auto,-exposure` has exposure off.

    Raises:
        DgsError: a name is unknown.
    """
    there = switches()
    words = [word.strip() for word in text.split(",") if word.strip()]
    mode = words[0] if words and words[0] in ("usual", "auto", "none", "all") else "named"
    names = tuple(words[1:] if mode != "named" else words)
    unknown = [name for name in names if name.removeprefix("-") not in there]
    if unknown or not words or (mode in ("usual", "none", "all") and names):
        raise DgsError(
            f"--effects '{text}' makes no sense" + (f": there is no effect '{unknown[0]}'" if unknown else ""),
            f"Write usual, auto, none, all, or names out of {', '.join(there)} with commas (auto,haze forces one on, "
            "auto,-haze off)",
        )
    return mode, names
