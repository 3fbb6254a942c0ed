"""A job that this Blender started: what was asked, the process that works on it, and where it stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..window import Pace
from .record import LOG, Record
from .request import Request
from .snapshot import SnapshotReader
from .state import JobState
from .worker import Worker

#: Seconds between two redraws of the panel while a job runs: at least, and where drawing is slow, at most.
REDRAW, SLOW_REDRAW = 0.5, 6.0
#: Of the time, drawing the panel may take this share: one slow moment in a hundred is not felt. A redraw takes
#: 5 ms with a graphics card; without one 50 ms, whatever of the window it is.
DRAWING = 0.01
#: The same for the live twin, each of which makes Blender evaluate and draw all splats.
LIVE, SLOW_LIVE, LIVE_DRAWING = 2.0, 20.0, 0.05


@dataclass
class Job:
    """A job that this Blender started.

    Attributes:
        scene: `session_uid` of the scene that asked for it: a name may change, and an undo makes another pointer.
        scene_name: what that scene was called then.
        record: what is kept beside the results.
        asked: when the user asked to stop, by the monotonic clock.
        pace, live_pace: how often the panel and the live twin are drawn.
        cloud: the finished twin's Gaussians, or the latest snapshot's, once read.
        news: whether something happened that the panel does not show yet.
        unseen: whether `cloud` is newer than the live twin.
        picture: of the twin so far, as `preview.read_preview` makes it, once read.
        finishing: what is still to be put into the scene after the end, a piece a tick.
        homeless: whether its twin is finished, was to come into the scene, and found none that takes it.
        live_twin: whether a live twin was shown; the user may have deleted it since.
        to_be_drawn, to_be_prepared: whether the process that draws its twin is still to be started, and its nodes made.
    """

    request: Request
    scene: int
    scene_name: str
    worker: Worker
    record: Record
    snapshots: SnapshotReader
    state: JobState = field(default_factory=JobState)
    asked: float | None = None
    cloud: Any = None
    unseen: bool = False
    news: bool = True
    picture: Any = None
    finishing: Iterator[None] | None = None
    homeless: bool = False
    live_twin: bool = False
    to_be_drawn: bool = False
    to_be_prepared: bool = False
    pace: Pace = field(default_factory=lambda: Pace(REDRAW, SLOW_REDRAW, DRAWING))
    live_pace: Pace = field(default_factory=lambda: Pace(LIVE, SLOW_LIVE, LIVE_DRAWING))

    @property
    def log(self) -> Path:
        """File with the engine's output."""
        return self.request.out / LOG
