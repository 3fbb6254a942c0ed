"""What all photos of a moving camera share: a rolling shutter that was given or found, and the camera's own curve."""

from __future__ import annotations

from dataclasses import replace

from ..errors import DgsError
from ..imaging.formation.chain import Formation
from ..imaging.formation.motion import CameraMotion
from ..progress import Progress
from ..shutter import ShutterRequest
from .simulated import SimulatedEffects


def check_shutter(request: ShutterRequest | None, motion: bool) -> None:
    """Raises a DgsError where a shutter is asked to roll and no motion of the camera may be simulated."""
    if request is not None and not motion:
        raise DgsError(
            "A rolling shutter shows only where the camera moves, and no motion is simulated",
            "Add --effects motion (or auto), or leave --rolling-shutter out",
        )


def with_shutter(effects: SimulatedEffects, request: ShutterRequest | None, progress: Progress) -> SimulatedEffects:
    """The same with the readout that was given; the very same where none was, as the training finds it then."""
    motion = effects.chosen.formation.motion
    if request is None or motion is None:
        if request is not None:
            progress.note("No motion of the camera is simulated, so its rolling shutter is not either")
        return effects
    if request.readout is None:
        return effects
    given = motion.rolling(request.readout)
    given.readout_given = True
    chosen = effects.chosen
    every = [given if isinstance(effect, CameraMotion) else effect for effect in chosen.formation.effects]
    return replace(effects, chosen=replace(chosen, formation=Formation(every)))


def shutter_found(formation: Formation) -> str:
    """What a training found of a rolling shutter, in words; '' where it found or sought none."""
    motion = formation.motion
    if motion is None or motion.readout_error is None or motion.readout == 0.0:
        return ""
    return (
        f"A rolling shutter: from the first to the last row {motion.readout:.2f} +- {2.0 * motion.readout_error:.2f} "
        "exposures pass, or as many from the last to the first"
    )


def curve_found(formation: Formation) -> str:
    """What a training found of the camera's own contrast, in words; '' where it is sRGB's or was not sought."""
    motion = formation.motion
    if motion is None or motion.curve_error is None or not motion.curve.notable:
        return ""
    toe, shoulder = (2.0 * error for error in motion.curve_error)
    return (
        f"The camera's own contrast, seen along the paths: toe {motion.curve.toe:.2f} +- {toe:.2f}, shoulder "
        f"{motion.curve.shoulder:.2f} +- {shoulder:.2f} (0 and 0: sRGB; above, it presses shadows or lights together)"
    )
