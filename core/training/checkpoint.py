"""A run's whole state in one file, so that it goes on exactly where it stopped.

The file is a plain numpy archive (no pickle): arrays, and one JSON text with the rest. What is
random is drawn from generators seeded by (seed, purpose, step), so no generator's state is kept.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CheckpointError
from ..files import replacing

#: Raised whenever the content changes its meaning.
FORMAT = 1


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
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, __facts__=text, **checkpoint.arrays)


def load_checkpoint(path: Path, fingerprint: dict[str, Any]) -> Checkpoint:
    """Reads a checkpoint that belongs to this very run.

    Raises:
        CheckpointError: the file is damaged, or belongs to other photos or settings.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        facts = json.loads(arrays.pop("__facts__").tobytes().decode("utf-8"))
        checkpoint = Checkpoint(
            arrays,
            facts["fingerprint"],
            int(facts["step"]),
            float(facts["seconds"]),
            list(facts["history"]),
            dict(facts["counters"]),
        )
        known = facts["format"]
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, json.JSONDecodeError) as error:
        raise CheckpointError(
            f"The checkpoint '{path}' is damaged ({type(error).__name__})", "Start again without --resume"
        ) from error
    if known != FORMAT:
        raise CheckpointError(
            f"The checkpoint '{path}' is of another version of this program", "Start again without --resume"
        )
    wanted = json.loads(json.dumps(fingerprint))
    differing = sorted(key for key in wanted if checkpoint.fingerprint.get(key) != wanted[key])
    if differing:
        raise CheckpointError(
            f"The checkpoint '{path}' belongs to a run with another {', '.join(differing)}",
            "Use the settings of that run, or start again without --resume",
        )
    return checkpoint
