"""What a measurement of the trade-off is asked to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..comparison.settings import StudySettings


@dataclass(frozen=True)
class TradeoffSettings(StudySettings):
    """One measurement; `only` names groups of knobs (`knobs.GROUPS`).

    Attributes:
        target: PSNR in dB whose time is reported; half a dB below the best point if None.
    """

    target: float | None = None

    NOT_DECIDING: ClassVar[tuple[str, ...]] = (*StudySettings.NOT_DECIDING, "target")
