"""How coarse a picture is while the view moves: so coarse that it comes in time, as measured on the last ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...core.numbers import number


@dataclass(frozen=True)
class PaceSettings:
    """Numbers of pictures that follow a movement."""

    frame: float = number(
        1 / 30,
        "s",
        "A picture may take so long while the view moves: half of what 15 a second leave, as the window's own drawing"
        " takes the other half where the same processor does it.",
    )
    rest: float = number(
        0.1,
        "s",
        "The view rests when it has not changed for so long: a hand that turns it stops for less, and the full picture"
        " still comes within 0.3 s.",
    )
    slow: float = number(
        1.5,
        "intervals",
        "Where the window is drawn so seldom that the view changes less often than it could rest, it rests when it has"
        " not changed for this many of its usual intervals.",
    )
    longest_rest: float = number(0.5, "s", "A pause that is longer is no interval of a movement.")
    coarsest: float = number(
        0.2,
        "share",
        "Pictures are no coarser than this, however long they take: hardly anything is to be seen on them, and with a"
        " million splats it is their number that takes the time, not that of the px.",
    )
    trust: float = number(0.5, "share", "Weight of the last picture's time against those before it, as times waver.")


PACE = PaceSettings()


class Pace:
    """The share of the full width and height that a picture in motion has."""

    def __init__(self, settings: PaceSettings = PACE) -> None:
        self._settings = settings
        self.share = 0.5

    def took(self, share: float, seconds: float) -> None:
        """Takes note of what a picture of this share took; its time goes with the number of its px."""
        fits = share * math.sqrt(self._settings.frame / max(seconds, 1e-4))
        mixed = math.exp(
            (1 - self._settings.trust) * math.log(self.share)
            + self._settings.trust * math.log(min(max(fits, self._settings.coarsest), 4.0))
        )
        self.share = min(1.0, max(self._settings.coarsest, mixed))
