"""A rolling shutter: the camera's motion as it was chosen, with the rows' own times."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..errors import DgsError
from ..imaging.formation.chain import Formation
from ..imaging.formation.motion import CameraMotion
from ..numbers import number
from ..progress import Progress
from ..shutter import ShutterRequest
from ..training.settings import TrainingSettings
from ..views import SparsePoints
from .effects.ablation import Ablation, Arm, Comparison
from .simulated import SimulatedEffects


@dataclass(frozen=True)
class ShutterSettings:
    """What `--rolling-shutter auto` tries."""

    readouts: tuple[float, ...] = number(
        (0.5, 1.0, 2.0),
        "exposures",
        "from the first row to the last one that are tried; none below 0, as those make the same photos",
        "a first choice; no other values were compared",
        "16 photos rendered by Cycles with a readout of 1: +1.48, +2.23 and +1.18 dB, errors of 0.2 to 0.4",
    )


SETTINGS = ShutterSettings()


def check_shutter(request: ShutterRequest | None, motion: bool) -> None:
    """Raises a DgsError where a shutter is asked to roll and no motion of the camera may be simulated."""
    if request is not None and not motion:
        raise DgsError(
            "A rolling shutter shows only where the camera moves, and no motion is simulated",
            "Add --effects motion (or auto), or leave --rolling-shutter out",
        )


def with_shutter(
    effects: SimulatedEffects,
    request: ShutterRequest,
    points: SparsePoints,
    settings: TrainingSettings,
    progress: Progress,
) -> SimulatedEffects:
    """The same with a shutter that rolls; the very same where no motion was chosen, or no readout is confirmed.

    Args:
        points, settings: of the training; trials are like it, but short.
    """
    motion = effects.chosen.formation.motion
    if motion is None:
        progress.note("No motion of the camera is simulated, so its rolling shutter is not either")
        return effects
    if request.readout is not None:
        return _rolling(effects, motion, request.readout)
    trials = Ablation(effects.fitted, points, effects.medium, settings)
    if not trials.possible:
        progress.note("Too few photos to try a rolling shutter: all rows are taken to be exposed at once")
        return effects
    tried = {r: _trial(trials, effects.chosen.formation, r) for r in SETTINGS.readouts}
    readout = best_readout(tried)
    progress.note(_said(tried, readout))
    return effects if readout is None else _rolling(effects, motion, readout)


def best_readout(tried: dict[float, Comparison]) -> float | None:
    """The readout that gains most, of those that gain beyond chance; None where none does."""
    confirmed = [readout for readout, found in tried.items() if found.confirms]
    return max(confirmed, key=lambda readout: tried[readout].mean, default=None)


def _trial(trials: Ablation, formation: Formation, readout: float) -> Comparison:
    return trials.compare(Arm(formation), Arm(_with_readout(formation, readout)))


def _with_readout(formation: Formation, readout: float) -> Formation:
    return Formation([e.rolling(readout) if isinstance(e, CameraMotion) else e for e in formation.effects])


def _rolling(effects: SimulatedEffects, motion: CameraMotion, readout: float) -> SimulatedEffects:
    if readout == motion.readout:
        return effects
    chosen = effects.chosen
    return replace(effects, chosen=replace(chosen, formation=_with_readout(chosen.formation, readout)))


def _said(tried: dict[float, Comparison], chosen: float | None) -> str:
    gains = ", ".join(f"{readout:g}: {c.mean:+.2f} +- {c.error:.2f} dB" for readout, c in tried.items())
    verdict = "all rows are exposed at once" if chosen is None else f"a readout of {chosen:g} exposures is simulated"
    return f"Rolling shutter tried ({gains}): {verdict}"
