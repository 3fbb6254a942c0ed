"""Decides which effects a run simulates."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np

from ...effects.inspect import inspect_photos
from ...effects.registry import all_effects, built, switches
from ...effects.spec import Switch
from ...errors import Cancelled, DgsError
from ...imaging.formation.chain import Formation
from ...imaging.formation.effect import Effect
from ...imaging.formation.exposure import Exposure
from ...imaging.formation.focus import LensFocus
from ...imaging.formation.glass import FrostedGlass
from ...imaging.formation.motion import CameraMotion
from ...imaging.formation.spreading import SpreadingEffect
from ...imaging.medium import Medium
from ...inspection.evidence import Evidence
from ...inspection.focus_by_points import focus_by_points
from ...inspection.photo_set import PhotoSet
from ...inspection.photometry import explained_elsewhere
from ...numbers import number
from ...photos.load import Photo
from ...progress import Progress
from ...reconstruction import Reconstruction
from ...views import View
from .ablation import Ablation, Arm, TrialCourse, TrialTerms
from .comparison import SETTINGS as TRIALS
from .confirmed import confirmed_by_points
from .corrected import corrected
from .decision import Decision, parse_effects


@dataclass(frozen=True)
class UsualSettings:
    """How cheaply a run looks that asks for no effect."""

    points: int = number(
        800,
        "count",
        "points of the cameras at most, evenly through their list",
        "0.3 to 2 s of processor time for 14 to 105 photos; no other number was tried",
        "benchmarks/exposure.py alarms, drawn sets; six real sets",
    )
    explained: float = number(
        0.15,
        "of the variance",
        "of the same points between photos that gains from other regions of space must explain, or it is not exposure"
        " that differs",
        "lego (rendered, gloss, no exposure) -0.15; copr 0.47, where learning it brings 0.27 dB",
        "brighton 0.88, drinks 0.83 (where it loses 0.05 dB), and, close to the limit, banana 0.17, tea 0.12",
    )
    sharp: float = number(0.3, "px", "standard deviation of the blur of photos that were given none")


USUAL = UsualSettings()
#: Why nothing can be tried on a small set.
TOO_FEW = "too few photos are there to try it"
#: Parts of a trial that progress is said in.
_PARTS = 100


@dataclass
class Chosen:
    """What a run simulates besides the point spread.

    Attributes:
        formation: the chain; masked: effects whose px do not count.
        decisions: one for every effect that can be switched; seen: evidence of what can only be seen.
        seconds: of it all.
    """

    formation: Formation = field(default_factory=Formation)
    masked: tuple[Switch, ...] = ()
    decisions: list[Decision] = field(default_factory=list)
    seen: list[Evidence] = field(default_factory=list)
    seconds: float = 0.0

    def forget_others(self, names: Iterable[str]) -> None:
        """Photos that no training sees have no exposure: theirs would be read from what is to judge the twin."""
        known = frozenset(names)
        effects = [e.for_photos(known) if isinstance(e, Exposure) else e for e in self.formation.effects]
        self.formation = Formation(effects)

    def with_learned(self, formation: Formation) -> Chosen:
        """The same with what a training has learned of it."""
        learned = {effect.name: dict(effect.described()) for effect in formation.effects}
        decisions = [replace(d, parameters=learned[d.name]) if d.name in learned else d for d in self.decisions]
        return replace(self, formation=formation, decisions=decisions)

    def corrected(self, views: Sequence[View]) -> list[View]:
        """What the twin is fitted to: views without the effects of lens and sensor, and without what is masked."""
        return corrected(views, self.formation, self.masked)

    def plain(self) -> list[dict[str, object]]:
        """For report.json: every effect's line."""
        rows = [decision.plain() for decision in self.decisions]
        for evidence in self.seen:
            why = "seen, but not simulated" if evidence.needed else "not needed"
            rows.append(Decision(evidence.name, False, why, evidence.plain(), seconds=evidence.seconds).plain())
        return rows


def choose_effects(
    asked: str,
    photos: Sequence[Photo],
    cameras: Reconstruction,
    views: Sequence[View],
    medium: Medium,
    terms: TrialTerms,
    progress: Progress,
) -> Chosen:
    """Inspects the photos, tries what they call for, and decides.

    Args:
        asked: as `--effects` takes it.
        views: those of the training; terms: what trials are bound to.

    Returns:
        The very same as without any effect where none is asked for, or 'usual' finds nothing.

    Raises:
        DgsError: an effect was forced on that these photos say nothing about.
        Cancelled: the user asked to stop.
    """
    mode, forced = parse_effects(asked)
    if mode == "none":
        return Chosen()
    if mode == "usual":
        return usual_effects(photos, cameras, views, medium, progress)
    began = time.perf_counter()
    there = switches()
    source = PhotoSet(list(photos), cameras)
    wanted = None if mode == "auto" else {s for switch in there.values() for s in switch.speakers}
    found = {e.name: e for e in inspect_photos(source, progress, wanted)}
    on, off = _by_name(mode, forced)
    trials = _Trials.called_for(found.values(), source) if mode == "auto" else _Trials()
    ablation = Ablation(views, cameras.points, medium, terms, progress) if mode == "auto" else None
    choice = _Choice(source, progress, ablation, trials)
    for name in sorted(on):
        choice.force(name, everything=mode == "all")
    tried = [name for name in trials.names if name not in on and name not in off]
    progress.stage("effects", _PARTS * len(tried))
    for index, name in enumerate(tried):
        if progress.cancelled():
            raise Cancelled("Stopped while effects were tried")
        if ablation is not None:
            ablation.course = TrialCourse(partial(_say_how_far, progress, index))
        choice.attempt(name)
        progress.advance(_PARTS * (index + 1))
    for name in there:
        why = "forced off" if name in off else ("not needed" if mode == "auto" else "not asked for")
        choice.lines.setdefault(name, Decision(name, False, why))
    chosen = choice.chosen(found, time.perf_counter() - began)
    simulated = [d.name for d in chosen.decisions if d.on]
    progress.note(f"Effects besides the blur: {', '.join(simulated) or 'none'}")
    return chosen


def _say_how_far(progress: Progress, before: int, share: float) -> None:
    """So many trials are over, and a share of the next one."""
    progress.advance(int(_PARTS * (before + share)))


def _by_name(mode: str, forced: Sequence[str]) -> tuple[set[str], set[str]]:
    """Effects that are switched on and off without being asked: by name, or as one of all."""
    everything = {name for name, switch in switches().items() if not switch.by_name_only}
    on = {name for name in forced if not name.startswith("-")} | (everything if mode == "all" else set())
    return on, {name.removeprefix("-") for name in forced if name.startswith("-")}


def usual_effects(
    photos: Sequence[Photo], cameras: Reconstruction, views: Sequence[View], medium: Medium, progress: Progress
) -> Chosen:
    """What a run does that asks for nothing: exposures, where the same points show that they differ.

    Only photos that are trained on are looked at, with few points, and no short training is made.
    """
    began = time.perf_counter()
    names = {view.name for view in views}
    points = cameras.points
    every = max(1, -(-len(points.positions) // USUAL.points))
    few = replace(cameras, points=points.chosen(np.arange(0, len(points.positions), every)))
    blur = max(medium.mean_sigma(sorted(names)), USUAL.sharp)
    source = PhotoSet([photo for photo in photos if photo.name in names], few, blur=blur)
    name, switch = Exposure.name, switches()[Exposure.name]
    found = {spec.name: spec.inspect(source) for spec in all_effects() if spec.name in switch.speakers}
    effect = built(name, source) if any(evidence.needed for evidence in found.values()) else None
    if effect is None or not _differs_everywhere(source):
        return Chosen(seconds=time.perf_counter() - began)
    why = "the photos show it"
    decision = Decision(name, True, why, seconds=time.perf_counter() - began)
    progress.note(
        f"The photos' exposure differs, so each photo's own is learned (--effects none leaves it out): "
        f"{next(e for e in found.values() if e.needed).evidence}"
    )
    simulated = {name: effect}
    lines = [_with_evidence(decision, found, simulated)]
    return Chosen(Formation([effect]), (), lines, [], time.perf_counter() - began)


def _differs_everywhere(source: PhotoSet) -> bool:
    """Whether gains of whole photos explain what differs between photos of the same points, not gloss or shadows."""
    observations = source.observations
    return observations is not None and explained_elsewhere(observations) >= USUAL.explained


def _focus_moves(source: PhotoSet) -> Literal["no", "perhaps", "surely"]:
    """Whether each photo has a focus of its own: by the same points, or where there are none, any photos may."""
    if source.cameras is None or not any(blur is not None for blur in source.blurs):
        return "no"
    if source.observations is None:
        return "perhaps"
    shown = source.once(focus_by_points)
    if shown is None or not shown.clear:
        return "no"
    return "surely" if shown.certain else "perhaps"


def proposed(found: Iterable[Evidence]) -> list[str]:
    """Effects that the evidence calls needed, the most certain first."""
    needed = {e.name: e.confidence for e in found if e.needed}
    sure = {
        name: max((needed[s] for s in switch.speakers if s in needed), default=0.0)
        for name, switch in sorted(switches().items(), key=lambda item: item[1].trial_rank)
    }
    return sorted((name for name in sure if sure[name] > 0), key=lambda name: -sure[name])


@dataclass(frozen=True)
class _Trials:
    """What is tried.

    Attributes:
        names: effects, in the order of their trials; called: those that the evidence calls needed.
        certain: those that points or spectra show beyond doubt: a trial may contradict, and need not confirm, and of a
            focus none is made.
    """

    names: tuple[str, ...] = ()
    called: frozenset[str] = frozenset()
    certain: frozenset[str] = frozenset()

    @staticmethod
    def called_for(found: Iterable[Evidence], source: PhotoSet) -> _Trials:
        """What the evidence calls needed, and what only a trial can show."""
        called = proposed(found)
        names, moves = list(called), _focus_moves(source)
        if FrostedGlass.name in names:
            names.remove(FrostedGlass.name)
            # Blur that differs between photos is not that of a glass.
            if CameraMotion.name not in called and moves != "surely":
                # Blur alike in all photos comes first, and alone: paths and foci would be taken for a part of it.
                names = [FrostedGlass.name, *(name for name in names if name != LensFocus.name)]
                return _Trials(tuple(names), frozenset(called), _certain(called, "no", source))
        if CameraMotion.name not in names and source.motion is not None and moves != "surely":
            names.append(CameraMotion.name)  # spectra show only paths that differ much from one another
        if moves != "no":
            names = [name for name in names if name != LensFocus.name]
            # Where points show a focus that moves it comes first: paths would be taken for a part of its blur.
            names.insert(len(names) if source.observations is None else 0, LensFocus.name)
        return _Trials(tuple(names), frozenset(called), _certain(called, moves, source))


def _certain(called: Sequence[str], moves: str, source: PhotoSet) -> frozenset[str]:
    """Effects that the same points, or the photos' spectra, show beyond doubt."""
    certain = [LensFocus.name] if moves == "surely" else []
    if CameraMotion.name in called and source.motion is not None and source.motion.certain:
        certain.append(CameraMotion.name)
    if Exposure.name in called and _differs_everywhere(source):
        certain.append(Exposure.name)  # what a run learns that asks for nothing
    return frozenset(certain)


@dataclass(frozen=True)
class _State:
    """What is on: simulations by name, and names of what is masked."""

    simulated: dict[str, Effect] = field(default_factory=dict)
    masking: tuple[str, ...] = ()

    def with_effect(self, name: str, effect: Effect | None) -> _State:
        """One more, which is masked if it has no simulation."""
        if effect is None:
            return _State(self.simulated, (*self.masking, name))
        return _State({**self.simulated, name: effect}, self.masking)

    def formation(self, without: Iterable[str] = ()) -> Formation:
        """The chain, in the order in which light meets the effects, whatever the order of the decisions."""
        return Formation([self.simulated[n] for n in switches() if n in self.simulated and n not in set(without)])

    def masked(self) -> tuple[Switch, ...]:
        """What is masked, in the same order."""
        return tuple(switch for name, switch in switches().items() if name in self.masking)


class _Choice:
    """The decisions so far.

    Args:
        ablation: None where nothing is tried; trials: what is.
    """

    def __init__(self, source: PhotoSet, progress: Progress, ablation: Ablation | None, trials: _Trials) -> None:
        self._source, self._progress, self._ablation, self._trials = source, progress, ablation, trials
        self.state = _State()
        self.lines: dict[str, Decision] = {}

    def force(self, name: str, everything: bool) -> None:
        """Switches on what was asked for, by name or as one of all.

        Raises:
            DgsError: the photos say nothing about it.
        """
        switch = switches()[name]
        effect = built(name, self._source)
        missing = effect is None and switch.build is not None
        if missing and everything and switch.unmeasured:
            why = "asked for, but too few regions of the photos show its size"
            self.lines[name] = Decision(name, False, why)
            return
        if missing and not switch.may_be_absent:
            why = self._source.no_observations
            if switch.unmeasured and self._source.observations is not None:
                why = switch.unmeasured
            raise DgsError(
                f"The effect '{name}' was asked for, but its size cannot be estimated: {why}",
                "Leave it out of --effects, or give cameras with points",
            )
        if not missing:
            self.state = self.state.with_effect(name, effect)
        why = "all were asked for" if everything else "forced on"
        self.lines[name] = Decision(name, not missing, "asked for, but no photo shows it" if missing else why)

    def attempt(self, name: str) -> None:
        """Tries one effect on top of those that are on; switches it on where it is confirmed."""
        kind = switches()[name].confirmed_by
        if kind == "evidence":
            self.lines[name] = self._by_evidence(name)
            return
        line = self._by_points(name, built(name, self._source)) if kind == "points" else self._by_trial(name)
        shared = switches()[name].shared
        if not line.on and shared is not None and name in self._trials.called:
            other = self._by_points(name, shared(self._source))
            line = other if other.on else line
        self.lines[name] = line

    def chosen(self, found: dict[str, Evidence], seconds: float) -> Chosen:
        """All decisions, with what the inspection found."""
        there = switches()
        speaking = {s for switch in there.values() for s in switch.speakers}
        return Chosen(
            self.state.formation(),
            self.state.masked(),
            [_with_evidence(self.lines[name], found, self.state.simulated) for name in there],
            [e for e in found.values() if e.name not in speaking],
            seconds,
        )

    def _by_trial(self, name: str) -> Decision:
        """A short training with the effect and without."""
        began = time.perf_counter()
        assert self._ablation is not None
        certain = name in self._trials.certain
        if not self._ablation.possible and not certain:
            return Decision(name, False, f"the photos call for it, but {TOO_FEW}")
        switch = switches()[name]
        effect = built(name, self._source)
        if effect is None and switch.build is not None:
            return Decision(name, False, "the photos call for it, but too few points are seen to estimate its size")
        more = self.state.with_effect(name, effect)
        if certain and name == LensFocus.name:  # a short training is too soft to say anything of it
            why = self._settled(name, more, f"{_showing(name)} show it beyond doubt")
            return Decision(name, True, why, seconds=time.perf_counter() - began)
        if not self._ablation.possible:
            return self._untried(name, more, TOO_FEW, began)
        # On the trial's coarse grid blurs that vary are below a px: they would cost time and show nothing.
        fine = [n for n, effect in self.state.simulated.items() if isinstance(effect, SpreadingEffect)]
        without, with_it = (Arm(state.formation(fine), state.masked()) for state in (self.state, more))
        result = self._ablation.compare(without, with_it, certain)
        if not result.made:
            return self._untried(name, more, result.seen, began)
        if len(result.differences) < TRIALS.fewest_judged:
            return Decision(name, False, "the photos call for it, but they are clipped too widely to confirm it")
        gained = f"{result.mean:+.3f} +- {result.error:.3f} dB on photos held out of a short training"
        shown = result.seen or gained + result.beside
        on = result.confirms
        if not on and certain and not result.contradicts:
            on, shown = True, f"{_showing(name)} show it beyond doubt, and nothing contradicts ({shown})"
        why = self._settled(name, more if on else None, shown)
        return Decision(name, on, why, None, result.mean, result.error, time.perf_counter() - began)

    def _untried(self, name: str, more: _State, reason: str, began: float) -> Decision:
        """Of an effect that cannot be tried: what is beyond doubt is simulated all the same."""
        if reason != TOO_FEW:
            self._progress.note(f"{name}: {reason}")
        if name not in self._trials.certain:
            why = f"the photos call for it, but {reason}"
            return Decision(name, False, why, seconds=time.perf_counter() - began)
        why = self._settled(name, more, f"{_showing(name)} show it beyond doubt; {reason}")
        return Decision(name, True, why, seconds=time.perf_counter() - began)

    def _by_evidence(self, name: str) -> Decision:
        """What the evidence calls needed, where that is a comparison between photos itself."""
        began = time.perf_counter()
        effect = built(name, self._source)
        if effect is None:
            return Decision(name, False, "the photos call for it, but too few points are seen to estimate its size")
        why = self._settled(name, self.state.with_effect(name, effect), "the same points in different photos show it")
        return Decision(name, True, why, seconds=time.perf_counter() - began)

    def _by_points(self, name: str, effect: Effect | None) -> Decision:
        """Whether the same points are blurrier where the effect says so."""
        began = time.perf_counter()
        points = confirmed_by_points(effect, self._source) if isinstance(effect, SpreadingEffect) else None
        if effect is None or points is None:
            return Decision(name, False, "the photos call for it, but too few points are seen to confirm it")
        shown = f"the same points in different photos show {points.share:.2f} +- {points.error:.2f} of it"
        why = self._settled(name, self.state.with_effect(name, effect) if points.confirms else None, shown)
        return Decision(name, points.confirms, why, seconds=time.perf_counter() - began)

    def _settled(self, name: str, state: _State | None, shown: str) -> str:
        """Goes on with `state` where the effect is confirmed; the sentence about it."""
        self.state = self.state if state is None else state
        why = f"called for, but not confirmed: {shown}" if state is None else f"confirmed: {shown}"
        self._progress.note(f"{name}: {why}")
        return why


def _showing(name: str) -> str:
    """What shows an effect beyond doubt."""
    return "the photos' spectra" if name == CameraMotion.name else "the same points"


def _with_evidence(decision: Decision, found: dict[str, Evidence], effects: dict[str, Effect]) -> Decision:
    speakers = [found[s] for s in switches()[decision.name].speakers if s in found]
    if not speakers:
        return decision
    first = max(speakers, key=lambda e: (e.needed, e.confidence))
    seconds = decision.seconds + sum(e.seconds for e in speakers)
    parameters = dict(effects[decision.name].described()) if decision.on and decision.name in effects else None
    return Decision(
        decision.name,
        decision.on,
        decision.why,
        first.plain(),
        decision.gain_db,
        decision.gain_error_db,
        seconds,
        parameters,
    )
