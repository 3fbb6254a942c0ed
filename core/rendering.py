"""What every rasterizer is asked for and gives back."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from torch import Tensor

from .constants import ALPHA_MINIMUM, LOW_PASS_VARIANCE, NEAR_PLANE

#: Opacity from which on a pixel has a depth worth dividing by.
OPAQUE_ENOUGH = 0.05


@dataclass(frozen=True)
class RasterSettings:
    """Choices of the image formation that all back ends share.

    Attributes:
        low_pass: variance (px^2) added to the projected covariance.
        antialias: scale the opacity by sqrt(det(cov) / det(cov + low_pass)), so that a splat
            thinner than the low-pass keeps its light (Mip-Splatting's 2D filter).
        alpha_minimum: evaluations below it are skipped; 0 makes the image smooth in its
            parameters (for gradient checks), at the price of speed.
        near: Gaussians nearer than this (world units) are culled.
        depth: also blend the depth of the centres (in world units, not divided by alpha).
    """

    low_pass: float = LOW_PASS_VARIANCE
    antialias: bool = False
    alpha_minimum: float = ALPHA_MINIMUM
    near: float = NEAR_PLANE
    depth: bool = False


@dataclass
class ScreenStatistics:
    """What one view says about each Gaussian; density control and reports read it.

    Attributes:
        radius: [N] float32, half-extent of the visible ellipse in px; 0 where culled.
        culled: counts by reason ('non_finite', 'behind', 'transparent', 'outside',
            'degenerate'), so that nothing is dropped silently.
        evaluations: number of Gaussian-pixel pairs evaluated (0 if the back end does not count).
        mean_gradient: [N, 2] gradient of the loss w.r.t. the projected centres in px,
            filled by the backward pass; None before it.
    """

    radius: Tensor
    culled: dict[str, int] = field(default_factory=dict)
    evaluations: int = 0
    mean_gradient: Tensor | None = None


@dataclass
class Rendered:
    """One rendered view.

    Attributes:
        image: [3, H, W] colours over the background, in the space the harmonics are in (sRGB).
        alpha: [H, W] opacity, 1 - transmittance.
        depth: [H, W] alpha-weighted depth of the centres, or None if not asked for.
        screen: per-Gaussian statistics.
    """

    image: Tensor
    alpha: Tensor
    depth: Tensor | None
    screen: ScreenStatistics

    @cached_property
    def mean_depth(self) -> Tensor | None:
        """[H, W] mean depth of what is seen, without gradient; the frame's median where next to nothing is."""
        if self.depth is None:
            return None
        alpha, depth = self.alpha.detach(), self.depth.detach()
        mean = depth / alpha.clamp(min=OPAQUE_ENOUGH)
        seen = alpha > OPAQUE_ENOUGH
        return mean.where(seen, mean[seen].median() if bool(seen.any()) else mean.new_ones(()))


@dataclass
class RenderedPath:
    """What a camera sees along its path.

    Attributes:
        images: [K, 3, H, W] as `Rendered.image`, one for each pose.
        screens: per-Gaussian statistics of each frame, or of all together, where a gradient is the sum of the frames'.
    """

    images: Tensor
    screens: tuple[ScreenStatistics, ...]


@dataclass
class RenderedLayers:
    """One view, and its layers by distance: each as it is seen where nothing nearer than its neighbours is there.

    Gaussians have a place [N] along the layers, from 0 for the farthest on. Layer k shows those less than 1 from k,
    each with the share 1 - |place - k|; what lies at k + 2 or nearer is not there. So a layer goes on behind what hides
    it.

    Attributes:
        numbers: of the layers that show anything, from the farthest on; one at least.
        planes: [L, 4, H, W] of each: colours (sRGB) times the share that they cover, and that share. The farthest one
            holds the background, too, so that its share is what nothing in it or before it covers.
        view: all Gaussians together, as `render` shows them; its depth is without gradient.
    """

    numbers: tuple[int, ...]
    planes: Tensor
    view: Rendered
