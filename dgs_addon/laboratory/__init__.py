"""The laboratory: photographs through a known medium of scenes that are known exactly.

Cycles renders a sharp scene; a point spread function then degrades the pictures as the medium
would. Importing this package needs no bpy; `synthesize` does.
"""

from __future__ import annotations

from pathlib import Path

from ...core.progress import Progress, Silent
from .settings import SynthesizeSettings

__all__ = ["SynthesizeSettings", "synthesize"]


def synthesize(settings: SynthesizeSettings, out: Path, progress: Progress | None = None) -> None:
    """Renders, degrades and writes a data set; see `dataset.synthesize`."""
    from .dataset import synthesize as write

    write(settings, out, progress or Silent())
