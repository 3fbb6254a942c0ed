"""What trials said, kept in the run's folder: a run that is resumed decides as it did, and makes none again.

Made again they could say something else: a run that is resumed begins with other points, and with a time limit it has
less time left. A checkpoint of what was decided before would then fit nothing.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np

from ...twin.folder import TwinFolder
from .comparison import Comparison


class KeptTrials:
    """The comparisons of one run.

    Args:
        folder: that keeps them; None where nothing is kept.
        resume: whether those that lie there are believed.
    """

    def __init__(self, folder: TwinFolder | None = None, resume: bool = False) -> None:
        self._folder = folder
        self._found = folder.trials() if folder is not None and resume else {}

    def get(self, asked: str) -> Comparison | None:
        """What the trial that was `asked` for said; None where it was not made."""
        kept = self._found.get(_digest(asked))
        if kept is None:
            return None
        least = math.inf if kept["least"] is None else kept["least"]
        differences, beside = np.array(kept["differences"], np.float64), kept.get("beside", "")
        return Comparison(differences, kept["seen"], least, beside)

    def put(self, asked: str, said: Comparison) -> None:
        """Keeps what it said.

        Raises:
            OutputError: it cannot be written.
        """
        if self._folder is None:
            return
        self._found[_digest(asked)] = {
            "differences": said.differences.tolist(),
            "seen": said.seen,
            "least": said.least if math.isfinite(said.least) else None,
            "beside": said.beside,
        }
        self._folder.save_trials(self._found)


def _digest(asked: str) -> str:
    return hashlib.sha256(asked.encode()).hexdigest()[:32]
