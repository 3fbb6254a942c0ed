"""How often something may be drawn, so that drawing takes a small share of the time. Knows no Blender."""

from __future__ import annotations


class Pace:
    """Allows a drawing when the last one is long enough ago, measured by what that one took.

    With a graphics card a drawing takes milliseconds and the least interval counts; without one it takes a
    twentieth of a second or more, and then comes less often.

    Args:
        least, most: seconds between two drawings.
        share: of the time that drawing may take.
    """

    def __init__(self, least: float, most: float, share: float) -> None:
        self._least, self._most, self._share = least, most, share
        self._shown: float | None = None
        #: Seconds that the last drawing took.
        self.cost = 0.0

    @property
    def interval(self) -> float:
        """Seconds that must lie between two drawings now."""
        return min(max(self._least, self.cost / self._share), self._most)

    def due(self, now: float) -> bool:
        """Whether a drawing may be asked for."""
        return self._shown is None or now - self._shown >= self.interval

    def asked(self, now: float) -> None:
        """A drawing was asked for; it happens as soon as this tick is over."""
        self._shown = now

    def drawn(self, now: float) -> None:
        """The drawing that was asked for is done."""
        if self._shown is not None:
            self.cost = max(0.0, now - self._shown)
