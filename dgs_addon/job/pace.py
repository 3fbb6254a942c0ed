"""How often something may be drawn, so that drawing takes a small share of the time. Knows no Blender."""

from __future__ import annotations


class Pace:
    """Allows a drawing when the last one is long enough ago, measured by what that one took.

    On a graphics card a drawing takes milliseconds and the least interval counts; without one it takes a
    tenth of a second or more, and then comes less often.

    Args:
        least, most: seconds between two drawings.
        share: of the time that drawing may take.
        tick: seconds between two calls of `due` where nothing delays them.
    """

    def __init__(self, least: float, most: float, share: float, tick: float) -> None:
        self._least, self._most, self._share, self._tick = least, most, share, tick
        self._before: float | None = None
        self._shown: float | None = None
        self._drew = False
        #: Seconds that the last drawing took.
        self.cost = 0.0

    @property
    def interval(self) -> float:
        """Seconds that must lie between two drawings now."""
        return min(max(self._least, self.cost / self._share), self._most)

    def due(self, now: float) -> bool:
        """Called at every tick: whether a drawing may be asked for."""
        if self._drew and self._before is not None:
            self.cost = max(0.0, now - self._before - self._tick)
            self._drew = False
        self._before = now
        return self._shown is None or now - self._shown >= self.interval

    def drawn(self, now: float) -> None:
        """A drawing was asked for; it happens before the next tick."""
        self._shown, self._drew = now, True
