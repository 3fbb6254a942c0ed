"""One resolution of the photos, and what belongs to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import PsfError
from ..imaging.spectrum import NoiseToSignal
from .grid import GridView
from .loss.objective import Objective
from .loss.through_glass import GlassObjective


@dataclass
class Level:
    """One resolution of the photos, with its objectives."""

    step: int
    views: list[GridView]
    heldout: list[GridView]
    margin: int
    ratio: NoiseToSignal | None
    contrast: float
    objectives: dict[Any, Objective] = field(default_factory=dict)
    behind_glass: dict[tuple[int, int], GlassObjective] = field(default_factory=dict)


def round_variance(views: Sequence[GridView]) -> float:
    """Variance (grid px^2) of the round Gaussian that blurs all views; 0 for none.

    Raises:
        PsfError: the point spread is another, or differs from view to view.
    """
    psf = views[0].psf
    if psf is None and all(view.psf is None for view in views):
        return 0.0
    own = any(view.psf is not psf for view in views)
    if psf is None or own or psf.samples is not None or abs(psf.sigma_x - psf.sigma_y) > 1e-6 * psf.sigma_x:
        raise PsfError("Only a round Gaussian can widen the splats themselves", "Choose another blur evaluation")
    return float(psf.sigma_x**2)
