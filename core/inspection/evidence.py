"""What the photos say about one effect, and when that is enough to call it needed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..numbers import number


@dataclass(frozen=True)
class EvidenceSettings:
    """Numbers of the judgement."""

    needed: float = number(
        0.9,
        "probability",
        "with which an effect is larger than the smallest visible one, from which on it is called needed",
        "judgement; set once, before benchmarks/effects.py was run",
        "benchmarks/effects.py: 0 of 168 decisions on 12 clean drawn sets were false alarms",
    )


SETTINGS = EvidenceSettings()


@dataclass(frozen=True)
class Evidence:
    """What was found out about one effect.

    Attributes:
        name: as `--effects` takes it.
        needed: whether the photos call for it.
        estimate: 'value' and 'error' (one standard deviation) in 'unit', 'smallest' (the smallest that counts as
            visible), and details; value None where it could not be measured.
        confidence: probability that `needed` is right, in [0, 1]; 0 where it could not be measured.
        evidence: one sentence.
        seconds: what it took.
        plots: values by photo, for the pictures only.
    """

    name: str
    needed: bool
    estimate: Mapping[str, Any]
    confidence: float
    evidence: str
    seconds: float = 0.0
    plots: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "needed": self.needed,
            "estimate": dict(self.estimate),
            "confidence": round(self.confidence, 4),
            "evidence": self.evidence,
            "seconds": round(self.seconds, 3),
        }


def judged(name: str, value: float, error: float, smallest: float, unit: str, text: str, **details: Any) -> Evidence:
    """Compares an estimate with the smallest visible effect, in units of its own uncertainty.

    Args:
        value, error: estimate and its standard deviation (>= 0).
        smallest: smallest effect that a user would see in the twin.
        text: the sentence.
        details: more for `estimate`.
    """
    if not (math.isfinite(value) and math.isfinite(error)):
        return unknown(name, unit, smallest, text)
    larger = 0.5 * (1.0 + math.erf((value - smallest) / max(error, 1e-9) / math.sqrt(2.0)))
    needed = larger > SETTINGS.needed
    estimate = {"value": shortened(value), "error": shortened(error), "unit": unit, "smallest": smallest, **details}
    return Evidence(name, needed, estimate, larger if needed else 1.0 - larger, text)


def unknown(name: str, unit: str, smallest: float, why: str) -> Evidence:
    """Nothing could be measured: not called needed, with no confidence."""
    return Evidence(name, False, {"value": None, "error": None, "unit": unit, "smallest": smallest}, 0.0, why)


def shortened(value: float) -> float:
    """To the four digits that reports show."""
    return float(f"{value:.4g}")
