"""One view's picture, which follows the view: coarse while it moves, full when it rests. Knows no Blender."""

from __future__ import annotations

from ...core.serving.messages import View
from .pace import PACE, Pace
from .picture_server import Picture, PictureServer

#: Sides of a picture in px at least.
_LEAST_SIDE = 16


class Follower:
    """Asks for what the view shows, and has the last picture that came.

    Args:
        channel: of the server, its own.

    Attributes:
        picture: the last one; of an earlier view while the view moves.
    """

    def __init__(self, channel: str) -> None:
        self.picture: Picture | None = None
        self._channel, self._pace = channel, Pace()
        self._wanted: tuple[object, View] | None = None
        self._asked: tuple[object, float] | None = None
        self._shown: tuple[object, float] | None = None
        self._moved, self._interval = -1e9, 0.0

    def show(self, key: object, view: View, now: float) -> None:
        """Says what the view shows now, at its full size.

        Args:
            key: equal for equal views; now: seconds.
        """
        if self._wanted is None or self._wanted[0] != key:
            since = now - self._moved
            self._interval = since if since < PACE.longest_rest else 0.0
            self._wanted, self._moved = (key, view), now

    def clear(self) -> None:
        """Nothing is to be seen: the picture goes, and comes anew for whatever is shown next."""
        self.picture = self._wanted = self._shown = None

    def step(self, server: PictureServer, now: float) -> bool:
        """Takes a picture that has come, and asks for the next; True if there is a new one to be drawn."""
        came = server.take(self._channel)
        if came is not None:
            self.picture, self._shown = came, self._asked
            if self._asked is not None:
                self._pace.took(self._asked[1], came.seconds)
        if self._wanted is not None and not server.waiting(self._channel):
            self._ask(server, now)
        return came is not None

    @property
    def done(self) -> bool:
        """Whether the full picture of the present view is there."""
        return self._wanted is None or self._shown == (self._wanted[0], 1.0)

    def _ask(self, server: PictureServer, now: float) -> None:
        assert self._wanted is not None
        key, view = self._wanted
        resting = now - self._moved >= max(PACE.rest, PACE.slow * self._interval)
        share = 1.0 if resting or self._pace.share > 0.95 else self._pace.share
        if self._shown is not None and self._shown[0] == key and (self._shown[1] == 1.0 or not resting):
            return  # it is there, or coarse and about to rest
        camera = view.camera
        sides = (max(_LEAST_SIDE, round(share * side)) for side in (camera.width, camera.height))
        self._asked = key, share
        server.ask(self._channel, view if share == 1.0 else view.resized(*sides))
