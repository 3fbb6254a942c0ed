"""Undistorted photos with their cameras: those that are trained on, and those that judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import CameraError
from ..photos.load import Photo
from ..photos.undistort import undistorted_views
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..views import View, fingerprint


@dataclass(frozen=True)
class SplitViews:
    """The views of a run.

    Attributes:
        fitted: those that are trained on; heldout: those that are not.
        names: of all photos with a camera, copies of held-out ones too.
    """

    fitted: list[View]
    heldout: list[View]
    names: list[str]


def split_views(
    photos: Sequence[Photo], cameras: Reconstruction, held: Sequence[str], progress: Progress
) -> SplitViews:
    """Undistorts photos that have a camera, and keeps copies of held-out ones out of the training too.

    Raises:
        CameraError: none is left to train on.
    """
    views = undistorted_views(list(photos), cameras)
    heldout = [view for view in views if view.name in held]
    seen = {fingerprint(view.photo) for view in heldout}
    fitted = [view for view in views if view.name not in held and fingerprint(view.photo) not in seen]
    copies = len(views) - len(fitted) - len(heldout)
    if copies:
        progress.note(f"{copies} photos are copies of held-out ones and were not trained on")
    if not fitted:
        what = "Every photo with a camera is held out, so none is left to train on"
        raise CameraError(what, "Use --holdout-every 0 or more photos")
    return SplitViews(fitted, heldout, [view.name for view in views])
