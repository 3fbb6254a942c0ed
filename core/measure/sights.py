"""What measuring needs of each camera: the twin's surface, and what the photo shows of it through the blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from ..camera import Camera
from ..errors import Cancelled
from ..forward import ForwardModel, low_pass_on_grid, shared_medium, sharp_depths, space_of
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.medium import BlurSpace
from ..mesh.surfaces import SURFACE
from ..numbers import number
from ..progress import Progress
from ..rasterizer import RasterSettings
from ..sfm.sharpen import LUMA
from ..training.grid import GridView
from ..training.scale import SceneScale
from ..twin.opened import OpenedTwin

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class SightSettings:
    """Of what is looked at."""

    patch: int = number(7, "px", "side of the window whose detail holds a place of the surface in its depth")
    cameras: int = number(40, "count", "that say how sure a place is, at most, evenly chosen")


SETTINGS = SightSettings()


@dataclass(frozen=True)
class Sight:
    """One camera and what it sees, in the scene's own units, on the photos' own grid.

    Attributes:
        camera: of the photo.
        depth: [H, W] of the surface along the axis; NaN where there is none.
        tensor: [3, H, W] sums over a window of the products gx gx, gx gy, gy gy of the degraded render's gradients
            (sRGB per px, all channels): how strongly the photo holds what it shows in its place.
        image: [3, H, W] float32 sRGB: the twin, sharp.
        blur: standard deviation of the photo's blur, px.
        trained: whether the twin was trained on the photo.
        view: the photo itself, with its point spread.
    """

    camera: Camera
    depth: Floats = field(repr=False)
    tensor: Floats = field(repr=False)
    image: Floats = field(repr=False)
    blur: float = 0.0
    trained: bool = True
    view: GridView | None = field(default=None, repr=False)

    @cached_property
    def grey(self) -> Floats:
        """[H, W] luma of the twin, sharp."""
        return np.tensordot(np.array(LUMA, np.float32), self.image, 1)


@dataclass(frozen=True)
class BlurOrigin:
    """Of the photos' point spreads.

    Attributes:
        space: that they act in.
        estimated: whether their widths were found from the photos, not given.
    """

    space: BlurSpace = "srgb"
    estimated: bool = False


@dataclass(frozen=True)
class Sights:
    """A twin as it is measured.

    Attributes:
        views: by photo name; scale: of the scene's own units.
        noise: root mean square of what the photos show otherwise than the twin through the blur, sRGB in [0, 1].
        gaussians: the twin in the scene's own units, for lines of sight that are no photo's.
        blur_is: where the photos' blur acts, and where it comes from.
    """

    views: dict[str, Sight]
    scale: SceneScale
    noise: float
    gaussians: Gaussians | None = None
    blur_is: BlurOrigin = BlurOrigin()

    @property
    def blur(self) -> float:
        """px, of the usual photo."""
        return float(np.median([sight.blur for sight in self.views.values()]))


def sights(twin: OpenedTwin, names: Sequence[str], progress: Progress) -> Sights:
    """What all cameras see.

    Args:
        names: photos that places are given in; held-out ones see, too, but say nothing about how sure a place is.

    Raises:
        Cancelled: the user asked to stop.
    """
    held = set(twin.held)
    kept = [view for view in twin.views if view.name not in held] or twin.views
    chosen = np.unique(np.linspace(0, len(kept) - 1, min(len(kept), SETTINGS.cameras)).round().astype(int))
    trained = {kept[index].name for index in chosen}
    wanted = [view for view in twin.views if view.name in trained or view.name in names]
    progress.stage("look", len(wanted))
    gaussians = twin.scale.to_unit(twin.gaussians)
    drawn = RasterSettings(low_pass=low_pass_on_grid(1))
    margin, space = twin.margin(1), space_of(twin.medium)
    model = ForwardModel(
        drawn, lambda v: shared_medium(v.psf, Frame(v.camera.height, v.camera.width, margin), space), margin
    )
    found, squares = dict[str, Sight](), []
    for index, view in enumerate(twin.on_grid(wanted, 1)):
        if progress.cancelled():
            raise Cancelled(f"Stopped after {index} of {len(wanted)} cameras; nothing was measured")
        depths = sharp_depths(gaussians, view.camera, drawn, held=SURFACE.held)
        surface = np.where(depths.alpha >= SURFACE.opacity, depths.surface, np.nan).astype(np.float32)
        w, h = view.camera.width, view.camera.height
        with torch.no_grad():
            seen = model.sharp(gaussians, view.camera, twin.background).image
            shown = model.medium(view).degraded(seen).numpy()
        if view.name in trained:
            valid = np.ones(surface.shape, bool) if view.valid is None else view.valid
            squares.append(float(((view.planes() - shown) ** 2)[:, valid].mean()))
        blur = 0.0 if view.psf is None else float(np.linalg.eigvalsh(view.psf.covariance)[-1]) ** 0.5
        found[view.name] = Sight(
            view.camera,
            surface,
            _tensor(shown),
            seen[:, margin : margin + h, margin : margin + w].numpy(),
            blur,
            view.name in trained,
            view,
        )
        progress.advance(index + 1)
    noise = max(float(np.sqrt(np.mean(squares))), kept[0].rounding)
    origin = BlurOrigin(space, twin.settings.medium.psf.startswith("auto"))
    return Sights(found, twin.scale, noise, gaussians.detached(), origin)


def _tensor(shown: Floats) -> Floats:
    gy, gx = np.gradient(shown, axis=(1, 2))
    parts = [(gx * gx).sum(axis=0), (gx * gy).sum(axis=0), (gy * gy).sum(axis=0)]
    return np.stack([uniform_filter(part, SETTINGS.patch) * SETTINGS.patch**2 for part in parts]).astype(np.float32)
