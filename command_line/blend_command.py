"""`blend`: a Blender scene with a twin and its cameras."""

from __future__ import annotations

import argparse

from .progress_choice import Reporting


def blend_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT with the twin and the cameras; needs bpy."""
    from ..dgs_addon.save_blend import save_blend

    save_blend(options.twin, options.cameras, options.out, options.photos)
    progress.finished({"blend": str(options.out)})
    return 0
