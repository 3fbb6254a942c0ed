"""What an effect is to the rest of the program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..imaging.formation.effect import Effect
    from ..imaging.formation.spreading import SpreadingEffect
    from ..inspection.evidence import Evidence
    from ..inspection.photo_set import PhotoSet

#: Where the smallest visible sizes come from.
SMALLEST_CHOSEN = "judgement of what shows in a twin; set once, before benchmarks/effects.py was run"
#: What they were checked on.
SMALLEST_CHECKED = "benchmarks/effects.py: 133 drawn sets of 12 scenes, all of one kind; no real photos"


@dataclass(frozen=True)
class EffectWords:
    """How report and panel speak of an effect.

    Attributes:
        label: a name of one to three words, in title case.
        tooltip: one sentence without its full stop, for the panel; empty where nothing can be switched.
        simulated: the report's sentence where it is on.
        missing: what the report names as left out where it is off, without a full stop; empty for nothing.
        blurred: what photos are called that it blurred, in the report's first sentence; empty where it blurs none.
        covered_by_own_blurs: whether `missing` is also covered where photos have point spreads of their own.
    """

    label: str
    tooltip: str = ""
    simulated: str = ""
    missing: str = ""
    blurred: str = ""
    covered_by_own_blurs: bool = False


@dataclass(frozen=True)
class Switch:
    """How a run takes an effect into account; it has either a simulation or a mask.

    Attributes:
        speakers: names of the evidence that speaks for it.
        trial_rank: of effects that are equally certain, those of a lower rank are tried first.
        simulation: its class. What lies behind the blur ('sensor') is undone on the photos before the training; the
            rest is simulated in every step.
        build: the simulation with the parameters that the photos show; None where they show none.
        counts: (photo [H, W, 3], its levels - 1) -> [H, W] px that still count, for effects that are masked.
        confirmed_by: 'trial': a short training with it and without; 'points': the same points in different photos;
            'evidence': what calls for it is such a comparison itself, and a short training could not judge it.
        shared: what a trial falls back on where it does not confirm the simulation: one that all photos share, which
            the same points in different photos have to confirm; None where there is none.
        may_be_absent: whether a set that does not show it is no error where it was asked for by name.
        by_name_only: whether 'all' leaves it out: most photos do not show it.
        unmeasured: why its size may be missing although points are seen in several photos.
    """

    speakers: tuple[str, ...]
    trial_rank: int
    simulation: type[Effect] | None = None
    build: Callable[[PhotoSet], Effect | None] | None = None
    counts: Callable[[NDArray[Any], int], NDArray[np.bool_]] | None = None
    confirmed_by: Literal["trial", "points", "evidence"] = "trial"
    shared: Callable[[PhotoSet], SpreadingEffect | None] | None = None
    may_be_absent: bool = False
    by_name_only: bool = False
    unmeasured: str = ""

    def __post_init__(self) -> None:
        if (self.simulation is None) == (self.counts is None) or (self.simulation is None) != (self.build is None):
            raise ValueError("An effect that can be switched has either a simulation and `build`, or `counts`")


@dataclass(frozen=True)
class EffectSpec:
    """One effect.

    Attributes:
        name: as `--effects`, `inspect` and report.json write it.
        physics: one sentence.
        words: for report and panel.
        inspect: what the photos show of it.
        switch: how a run takes it into account; None where it can only be seen.
    """

    name: str
    physics: str
    words: EffectWords
    inspect: Callable[[PhotoSet], Evidence]
    switch: Switch | None = None
