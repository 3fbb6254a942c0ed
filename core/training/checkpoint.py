"""A run's whole state in one file, so that it goes on exactly where it stopped.

The file is a plain numpy archive (no pickle): arrays, and one JSON text with the rest. What is
random is drawn from generators seeded by (seed, purpose, step), so no generator's state is kept.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..constants import SH_COEFFICIENTS
from ..errors import CheckpointError
from ..files import parse_json, replacing
from ..json_shape import anything, check_shape, count, number, text
from ..npy import read_npz
from .origin import CONTENTS, first_difference

#: Raised whenever the content changes its meaning.
FORMAT = 1

#: Sides of a parameter behind the number of Gaussians.
_SIDES = {"means": (3,), "log_scales": (3,), "quaternions": (4,), "opacity_logits": ()}


def _any_number(value: object) -> bool:
    """Number, even one that is not finite: a loss may be."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


#: What is read of the JSON.
_FACTS = {
    "format": count,
    "fingerprint": {"photos?": [text], "*": anything},
    "step": count,
    "seconds": number,
    "history": [{"step": number, "*": _any_number}],
    "counters": {"steps": count, "*": count},
}


@dataclass
class Checkpoint:
    """What a run needs to go on.

    Attributes:
        arrays: parameters, moments and density statistics by name.
        fingerprint: what must be equal for the state to fit: settings, photos, medium.
        step: iterations done.
        seconds: training time spent so far.
        history, counters: as in `Trained`.
    """

    arrays: dict[str, NDArray[Any]]
    fingerprint: dict[str, Any]
    step: int
    seconds: float
    history: list[dict[str, float]] = field(default_factory=list)
    counters: dict[str, int] = field(default_factory=dict)


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Writes the file whole or not at all.

    Raises:
        OutputError: the disk is full or the place cannot be written to.
    """
    facts = {
        "format": FORMAT,
        "fingerprint": checkpoint.fingerprint,
        "step": checkpoint.step,
        "seconds": checkpoint.seconds,
        "history": checkpoint.history,
        "counters": checkpoint.counters,
    }
    text = np.frombuffer(json.dumps(facts).encode("utf-8"), np.uint8)
    archive = io.BytesIO()  # (an archive that is cut off by a full disk complains once more when it is collected)
    np.savez(archive, __facts__=text, **checkpoint.arrays)
    with replacing(path) as temporary:
        temporary.write_bytes(archive.getbuffer())


def load_checkpoint(path: Path, fingerprint: dict[str, Any]) -> Checkpoint:
    """Reads a checkpoint that belongs to this very run.

    Args:
        fingerprint: of this run; empty where any will do.

    Raises:
        CheckpointError: the file is damaged, or belongs to other photos, cameras or settings.
    """
    try:
        arrays = read_npz(path)
        facts = parse_json(arrays.pop("__facts__").tobytes())
        known = facts["format"] if isinstance(facts, dict) else None
        if known == FORMAT:
            check_shape(facts, _FACTS)
            _check_arrays(arrays)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError) as error:
        raise CheckpointError(
            f"The checkpoint '{path}' is damaged ({type(error).__name__}: {error})", "Start again without --resume"
        ) from error
    if known != FORMAT:
        raise CheckpointError(
            f"The checkpoint '{path}' is of another version of this program", "Start again without --resume"
        )
    fitting, history, counters = facts["fingerprint"], facts["history"], facts["counters"]
    checkpoint = Checkpoint(arrays, fitting, facts["step"], float(facts["seconds"]), history, counters)
    if fingerprint:
        _check_fit(path, fitting, json.loads(json.dumps(fingerprint)))
    return checkpoint


def _check_fit(path: Path, kept: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Raises CheckpointError where a checkpoint's fingerprint is not this run's."""
    begun = f"The checkpoint '{path}'"
    compared = (kept.keys() | wanted.keys()) - {*CONTENTS, "cameras", "points"}
    differing = sorted(key for key in compared if kept.get(key) != wanted.get(key))
    if differing:
        raise CheckpointError(
            f"{begun} belongs to a run with another {', '.join(differing)}",
            "Use the settings of that run, or start again without --resume",
        )
    if wanted.keys() - kept.keys():
        raise CheckpointError(
            f"{begun} is of an earlier version, which did not keep what the photos and cameras were",
            "Start again without --resume",
        )
    if difference := first_difference(kept, wanted):
        raise CheckpointError(f"{begun} {difference}", "Start again without --resume")


def _check_arrays(arrays: dict[str, NDArray[Any]]) -> None:
    """Arrays of one training agree with one another: native code trusts them.

    Raises:
        ValueError: it names the array.
    """
    sides: dict[str, tuple[int, ...]] = {**_SIDES, "sh": _sides_of_harmonics(arrays)}
    wanted = {f"{kind}.{name}": side for kind in ("value", "first", "second") for name, side in sides.items()}
    wanted |= {"pull": (), "views": ()}
    amount = len(arrays["value.means"]) if arrays.get("value.means", np.zeros(())).ndim else 0
    for name, side in wanted.items():
        if name not in arrays:
            raise ValueError(f"the array '{name}' is missing")
        array = arrays[name]
        if not amount or array.shape != (amount, *side) or array.dtype != np.float32:
            raise ValueError(f"the array '{name}' is {array.dtype} {array.shape}, not float32 {(amount or 1, *side)}")
        if name.startswith(("first.", "second.")) and not np.isfinite(array).all():
            raise ValueError(f"the array '{name}' is not finite")
        if name.startswith("second.") and (array < 0).any():
            raise ValueError(f"the array '{name}' is negative, a mean of squares")


def _sides_of_harmonics(arrays: dict[str, NDArray[Any]]) -> tuple[int, ...]:
    harmonics = arrays.get("value.sh", np.zeros(())).shape
    return (harmonics[1] if len(harmonics) == 3 and harmonics[1] in SH_COEFFICIENTS else SH_COEFFICIENTS[0], 3)
