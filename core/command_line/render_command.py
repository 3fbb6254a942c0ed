"""`render`: images of a twin from the cameras of a model."""

from __future__ import annotations

import argparse

from ..errors import Cancelled
from .progress_choice import Reporting


def render_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Writes OUT/NAME.png for every camera of the model, sharp or through the given PSF."""
    from ..files import check_writable
    from ..formats.ply import read_ply
    from ..imaging.medium import Medium
    from ..imaging.psf import parse_psf

    psf = parse_psf(options.psf)
    cloud = read_ply(options.twin)
    check_writable(options.out)

    from ..gaussians import Gaussians
    from ..pipeline.heldout import render_names, write_png
    from ..pipeline.machine import choose_device, use_threads
    from ..pipeline.views import Viewer, to_pixels
    from ..sfm.known import read_cameras
    from ..training.scale import scene_scale
    from ..views import SparsePoints

    use_threads(options.threads)
    lenses, poses, _ = read_cameras(options.cameras)
    medium = Medium(psf, options.blur_space)
    viewer_points = SparsePoints(cloud.means.astype(float), cloud.means.astype("uint8"))
    scale = scene_scale([_pinhole(name, lenses[name], poses[name]) for name in sorted(poses)], viewer_points)
    viewer = Viewer(Gaussians.from_cloud(cloud), scale, choose_device(options.device))
    files = render_names(sorted(poses))
    progress.stage("render", len(files))
    for index, (name, file) in enumerate(files.items()):
        if progress.cancelled():
            raise Cancelled(f"Stopped after {index} of {len(files)} pictures; they are in '{options.out}'")
        write_png(options.out / file, to_pixels(viewer.degraded(lenses[name], poses[name], medium, name)))
        progress.advance(index + 1)
    progress.finished({"pictures": len(files), "folder": str(options.out)})
    return 0
