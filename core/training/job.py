"""What a training starts from, in one piece."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..views import SparsePoints, View
from .cameras.adjusting import Adjust
from .settings import TrainingSettings


@dataclass(frozen=True)
class TrainingJob:
    """All that `train` needs besides where it writes.

    Attributes:
        views: photos to fit, with cameras in any world; heldout: photos to watch only.
        points: sparse points in the same world.
        medium, formation: point spreads, and effects besides them.
        evaluated: whether held-out photos are looked at in the course of the run, too, and not only at its end.
        adjust: which cameras may be moved where paths are learned.
        restore: whether shaken photos may be restored on the way, and new Gaussians be fitted to them.
        ample: Gaussians that the photos show amply (`density.budget`), which a time limit plans with; 0 where they are
            blurred or the camera moved.
    """

    views: Sequence[View]
    heldout: Sequence[View]
    points: SparsePoints
    medium: Medium
    settings: TrainingSettings
    formation: Formation = Formation()
    evaluated: bool = True
    adjust: Adjust = "never"
    restore: bool = False
    ample: int = 0


@dataclass(frozen=True)
class PlannedTraining:
    """A training fitted into the time there is.

    Attributes:
        settings: of the training.
        plan: to be kept in the twin's folder, so that a resumed run goes on with it; None where nothing was planned.
        enough: there is more time than the longest training takes.
    """

    settings: TrainingSettings
    plan: Mapping[str, Any] | None = None
    enough: bool = False
