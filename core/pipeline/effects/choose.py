"""Decides which effects a run simulates."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...errors import Cancelled, DgsError
from ...imaging.formation.chain import Formation
from ...imaging.formation.effect import Effect
from ...imaging.formation.layered import SpreadingEffect
from ...imaging.medium import Medium
from ...inspection.evidence import Evidence
from ...inspection.inspect import inspect_photos
from ...inspection.photo_set import PhotoSet
from ...photos.load import Photo
from ...progress import Progress
from ...reconstruction import Reconstruction
from ...training.settings import TrainingSettings
from ...views import View
from .ablation import FEWEST, Ablation
from .confirmed import told_by_points
from .decision import SWITCHED, Decision, parse_effects
from .proposal import BLURS, SPEAKS, build, proposed


@dataclass
class Chosen:
    """What a run simulates besides the point spread.

    Attributes:
        formation: the chain; saturation: whether clipped px are masked.
        decisions: one for every effect that can be switched; seen: evidence of what can only be seen.
        seconds: of it all.
    """

    formation: Formation = field(default_factory=Formation)
    saturation: bool = False
    decisions: list[Decision] = field(default_factory=list)
    seen: list[Evidence] = field(default_factory=list)
    seconds: float = 0.0

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
    settings: TrainingSettings,
    progress: Progress,
) -> Chosen:
    """Inspects the photos, tries what they call for, and decides.

    Args:
        asked: as `--effects` takes it.
        views: those of the training.

    Raises:
        DgsError: an effect was forced on that these photos say nothing about.
        Cancelled: the user asked to stop.
    """
    mode, forced = parse_effects(asked)
    if mode == "none":
        return Chosen()
    began = time.perf_counter()
    source = PhotoSet(list(photos), cameras)
    wanted = None if mode == "auto" else {s for name in SWITCHED for s in SPEAKS[name]}
    found = {e.name: e for e in inspect_photos(source, progress, wanted)}
    on = {name for name in forced if not name.startswith("-")} | (set(SWITCHED) if mode == "all" else set())
    off = {name.removeprefix("-") for name in forced if name.startswith("-")}
    candidates = proposed(found.values()) if mode == "auto" else []
    ablation = Ablation(views, cameras.points, medium, settings) if mode == "auto" else None
    effects: dict[str, Effect] = {}
    chosen = Chosen(seen=[e for e in found.values() if not any(e.name in s for s in SPEAKS.values())])
    lines: dict[str, Decision] = {}
    for name in sorted(on):
        if mode == "all" and name in BLURS and build(name, source) is None:
            lines[name] = Decision(name, False, "asked for, but too few regions of the photos tell its size")
            continue
        _switch_on(name, source, effects, chosen)
        there, why = name in effects or name == "saturation", "all were asked for" if mode == "all" else "forced on"
        lines[name] = Decision(name, there, why if there else "asked for, but no photo shows it")
    tried = [name for name in candidates if name not in on and name not in off]
    progress.stage("effects", len(tried))
    for index, name in enumerate(tried):
        if progress.cancelled():
            raise Cancelled("Stopped while effects were tried")
        lines[name] = _tried(name, source, effects, chosen, ablation, progress)
        progress.advance(index + 1)
    for name in SWITCHED:
        if name not in lines:
            why = "forced off" if name in off else ("not needed" if mode == "auto" else "not asked for")
            lines[name] = Decision(name, False, why)
        chosen.decisions.append(_with_evidence(lines[name], found, effects))
    chosen.formation = _chain(effects)
    chosen.seconds = time.perf_counter() - began
    simulated = [d.name for d in chosen.decisions if d.on]
    progress.note(f"Effects besides the blur: {', '.join(simulated) or 'none'}")
    return chosen


def _tried(
    name: str,
    source: PhotoSet,
    effects: dict[str, Effect],
    chosen: Chosen,
    ablation: Ablation | None,
    progress: Progress,
) -> Decision:
    """Ablation of one effect on top of those that are on; switches it on where it gains."""
    began = time.perf_counter()
    assert ablation is not None
    if name in BLURS:
        return _asked_points(name, source, effects, progress)
    if not ablation.possible:
        return Decision(name, False, "the photos call for it, but too few are there to confirm it")
    effect = build(name, source)
    if effect is None and name != "saturation":
        return Decision(name, False, "the photos call for it, but too few points are seen to tell its size")
    more = effects if effect is None else {**effects, name: effect}
    masks = chosen.saturation, chosen.saturation or name == "saturation"
    # On the trial's coarse grid blurs that vary are below a px: they would cost time and tell nothing.
    without, with_it = ({n: e for n, e in part.items() if n not in BLURS} for part in (effects, more))
    result = ablation.compare(_chain(without), _chain(with_it), masks)
    if len(result.differences) < FEWEST:
        return Decision(name, False, "the photos call for it, but they are clipped too widely to confirm it")
    told = f"{result.mean:+.3f} +- {result.error:.3f} dB on photos held out of a short training"
    if result.confirms:
        effects.update(more)
        chosen.saturation = masks[1]
    why = f"confirmed: {told}" if result.confirms else f"called for, but not confirmed: {told}"
    progress.note(f"{name}: {why}")
    return Decision(name, result.confirms, why, None, result.mean, result.error, time.perf_counter() - began)


def _asked_points(name: str, source: PhotoSet, effects: dict[str, Effect], progress: Progress) -> Decision:
    """Whether the same points are blurrier where one effect says so; switches it on where they are."""
    began = time.perf_counter()
    effect = build(name, source)
    told = told_by_points(effect, source) if isinstance(effect, SpreadingEffect) else None
    if effect is None or told is None:
        return Decision(name, False, "the photos call for it, but too few points are seen to confirm it")
    shown = f"the same points in different photos show {told.share:.2f} +- {told.error:.2f} of it"
    if told.confirms:
        effects[name] = effect
    why = f"confirmed: {shown}" if told.confirms else f"called for, but not confirmed: {shown}"
    progress.note(f"{name}: {why}")
    return Decision(name, told.confirms, why, seconds=time.perf_counter() - began)


def _switch_on(name: str, source: PhotoSet, effects: dict[str, Effect], chosen: Chosen) -> None:
    if name == "saturation":
        chosen.saturation = True
        return
    effect = build(name, source)
    if effect is None and name == "motion":  # a set without motion is no error, and costs nothing
        return
    if effect is None:
        why = source.no_tracks
        if name in BLURS and source.tracks is not None:
            why = "too few regions hold detail" + (" at depths that differ" if name == "defocus" else "")
        raise DgsError(
            f"The effect '{name}' was asked for, but its size cannot be told: {why}",
            "Leave it out of --effects, or give cameras with points",
        )
    effects[name] = effect


def _chain(effects: dict[str, Effect]) -> Formation:
    """In the order in which light meets them, whatever the order of the decisions."""
    return Formation([effects[name] for name in SWITCHED if name in effects])


def _with_evidence(decision: Decision, found: dict[str, Evidence], effects: dict[str, Effect]) -> Decision:
    speakers = [found[s] for s in SPEAKS[decision.name] if s in found]
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
