"""Whether smaller views are to be asked: photos that are blurred, each in its own way, show each other nothing fine."""

from __future__ import annotations

from dataclasses import dataclass

from ..numbers import number


@dataclass(frozen=True)
class SmallerSettings:
    """When views are too large for what their photos show."""

    doubtful: float = number(
        0.45,
        "share",
        "of what views show that they agree on, below which smaller ones are asked",
        "cameras without points: a village from above, 30 photos, 0.46 sharp, 0.11 shaken by 6 to 28 px; around points:"
        " a ball, 20 photos shaken by 6 to 20 px, 0.39",
        "sharp, cameras without points: shelf, room, ball, another village 0.52 to 0.81; around points: shelf 0.74,"
        " village 0.55",
    )
    clearly_more: float = number(
        1.4,
        "ratio",
        "of what smaller views agree on, from which on these are taken: where photos are sharp it is little above 1",
        "that village: 1.03 sharp, 2.2 shaken (a draft 23.18 dB -> 23.76)",
        "that ball: 2.5, 25.10 dB -> 25.50, around points 1.56, 24.47 -> 24.70; sharp around points 1.12, 1.18",
    )

    def asked(self, share: float) -> bool:
        """Whether smaller views are asked, where these agree on a share."""
        return share < self.doubtful

    def taken(self, share: float, smaller: float) -> bool:
        """Whether smaller ones, that agree on another share, are taken."""
        return smaller > self.clearly_more * share
