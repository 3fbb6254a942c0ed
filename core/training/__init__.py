"""From photos with cameras to Gaussians: `train` is the door."""

from __future__ import annotations

from .run import Trained, train
from .settings import Rates, TrainingSettings

__all__ = ["Rates", "Trained", "TrainingSettings", "train"]
