"""How fine a surface is seen: the share of its detail that a photo resolves through the blur, octave by octave.

Locally a surface is taken for a picture whose contrast has the same variance in every octave, as natural pictures have.
Then Fisher's information through the blur is diagonal in the frequencies, neighbours' couplings included: of the
variance P(f) of a frequency f, a photo with noise n whose blur passes the power M^2(f) resolves the share

    P M^2 / (P M^2 + n^2),   P = v / (1.5 pi f^2),   v the variance of the octave, 1.5 pi f^2 its area [1/px^2]

f in the photo's own px: who stands farther off, or aslant, sees the same detail at a higher frequency or on fewer px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..constants import SH_C0
from ..imaging.psf import PointSpread
from ..numbers import BY_DEFINITION, number
from .linear_model import LinearModel, Viewpoint

#: Rows of a table of distances at a time: memory only.
ROWS = 4096


@dataclass(frozen=True)
class DetailSettings:
    """What detail is, and how far from one side to another it carries."""

    octaves: tuple[float, ...] = number(
        (0.36, 0.18, 0.09, 0.045),
        "cycles/px of the views that are wanted",
        "middles of the octaves: from half a cycle, all that a px can show, down to detail of 30 px, which the twin "
        "gets right from any photo",
        BY_DEFINITION,
    )
    turns: tuple[float, ...] = number(
        (25.0, 30.0, 35.0, 45.0),
        "deg",
        "angles after which what a photo resolved of an octave is mostly open again, fine octaves first: depths are "
        "never exact, and fine detail feels it first; other angles were tried without gain",
        "the truth of 8 twins of the synthetic scenes of benchmarks/next_view.py, seeds 10 to 12",
        "the whole choice only, seeds 0 to 4 of the same scenes; no real photos",
    )
    window: int = number(7, "px", "side of the window of local contrast: about two periods of the middle octaves")
    mean_share: float = number(
        0.1, "share", "of the scene's mean in the contrast, the rest is what photos show: what looks plain may not be"
    )
    neighbours: int = number(8, "count", "what no photo shows is taken for like so many nearest ones that photos show")
    among: int = number(2000, "count", "Gaussians that such neighbours are sought among: speed only")
    minimum_seen: float = number(0.05, "px", "a Gaussian that covers less of all photos together is not seen")
    own_contrast_from: float = number(1.0, "px", "of all photos together, from which a Gaussian's own contrast counts")


class Detail:
    """What photos resolve of the Gaussians' detail.

    Args:
        linear: at the twin; noise: standard deviation of a photo's px, sRGB.
        wanted: viewpoints from which the twin may be looked at: their px say what detail is.
        photos: that are there, whose contrast is the measure.
    """

    def __init__(
        self,
        linear: LinearModel,
        noise: float,
        wanted: Sequence[Viewpoint],
        photos: Sequence[Viewpoint],
        settings: DetailSettings = DetailSettings(),
    ) -> None:
        self.settings = settings
        self.octaves = torch.tensor(settings.octaves)
        self.turns = torch.tensor(tuple(float(np.radians(degrees)) for degrees in settings.turns))
        self.linear, self.noise = linear, noise
        plain = torch.zeros((len(linear.gaussians), 1, 3))  # (a black Gaussian's own colour would have no gradient)
        self._plain = replace(linear.gaussians, sh=plain)
        self._resolved: dict[int, tuple[Viewpoint, Tensor]] = {}
        self._seen: dict[int, tuple[Viewpoint, Tensor]] = {}
        sizes, pixels = torch.zeros(len(plain)), torch.zeros(len(plain))
        largest = torch.full((len(plain),), 1e-12)
        for viewpoint in wanted:
            size, pixel = self.seen(viewpoint), self.pixel(viewpoint)
            sizes, pixels = sizes + size, pixels + size * pixel
            largest = torch.maximum(largest, size * pixel**2)
        anywhere = torch.stack([self.pixel(viewpoint) for viewpoint in wanted]).mean(dim=0)
        self.largest, self.wanted_pixel = largest, torch.where(sizes > settings.minimum_seen, pixels / sizes, anywhere)
        self.variance = self._contrast(photos)

    def weights(self, viewpoint: Viewpoint, planes: Sequence[Tensor]) -> list[Tensor]:
        """[N] sum over the sharp view's px of each Gaussian's share times each of several [H, W] planes."""
        sh = self._plain.sh.clone().requires_grad_()
        image = self.linear.seen(viewpoint, sh).image
        out = []
        for index, plane in enumerate(planes):
            upstream = (plane / 3.0).expand(3, *plane.shape).contiguous()
            (gradient,) = torch.autograd.grad(image, sh, upstream, retain_graph=index + 1 < len(planes))
            out.append(torch.nan_to_num(gradient[:, 0].sum(dim=1) / SH_C0, 0.0, 0.0, 0.0))
        return out

    def seen(self, viewpoint: Viewpoint) -> Tensor:
        """[N] px that each Gaussian covers in the sharp view; kept."""
        if id(viewpoint) not in self._seen:  # (the viewpoint is kept too, so that its id stays its own)
            ones = torch.ones((viewpoint.camera.height, viewpoint.camera.width))
            self._seen[id(viewpoint)] = viewpoint, self.weights(viewpoint, [ones])[0].clamp(min=0.0)
        return self._seen[id(viewpoint)][1]

    def rays(self, viewpoint: Viewpoint) -> tuple[Tensor, Tensor]:
        """[N, 3] unit vectors from the Gaussians to the camera, and [N] distances."""
        rays = torch.from_numpy(viewpoint.camera.centre).float() - self.linear.gaussians.means
        distance = rays.norm(dim=1).clamp(min=1e-12)
        return rays / distance[:, None], distance

    def pixel(self, viewpoint: Viewpoint) -> Tensor:
        """[N] size of a px of the viewpoint at each Gaussian, in the scene's units."""
        return self.rays(viewpoint)[1] / float(viewpoint.camera.fx)

    def passed(self, viewpoint: Viewpoint) -> Tensor:
        """[N, octaves] power that the blur lets through; 0 for what is finer than the viewpoint's px."""
        frequencies = self._frequencies(viewpoint)
        return passed(viewpoint.psf, frequencies)

    def resolved(self, viewpoint: Viewpoint) -> Tensor:
        """[N, octaves] share of the variance that a photo there resolves of what is seen from its side; kept."""
        if id(viewpoint) not in self._resolved:
            frequencies = self._frequencies(viewpoint)
            signal = self.variance[:, None] / len(self.octaves) * passed(viewpoint.psf, frequencies)
            noise = 1.5 * np.pi * frequencies.square() * self.noise**2
            visible = (self.seen(viewpoint) * self.pixel(viewpoint) ** 2 / self.largest).clamp(max=1.0)
            share = signal / (signal + noise)
            self._resolved[id(viewpoint)] = viewpoint, torch.nan_to_num(visible[:, None] * share)
        return self._resolved[id(viewpoint)][1]

    def _frequencies(self, viewpoint: Viewpoint) -> Tensor:
        scale = self.pixel(viewpoint) / self.wanted_pixel.clamp(min=1e-12)
        return scale[:, None] * self.octaves

    def _contrast(self, photos: Sequence[Viewpoint]) -> Tensor:
        """[N] variance of the colours around each Gaussian, as the twin shows them where the photos look."""
        total, covered = (torch.zeros(len(self.linear.gaussians)) for _ in range(2))
        for viewpoint in photos:
            top, bottom = self.weights(viewpoint, [self.around(viewpoint), torch.ones_like(self.around(viewpoint))])
            total, covered = total + top, covered + bottom
        mean = total.sum() / covered.sum().clamp(min=1e-9)
        shown = covered > self.settings.own_contrast_from
        local = torch.where(shown, total / covered.clamp(min=self.settings.minimum_seen), mean)
        rows_shown = torch.nonzero(shown)[:, 0]
        rows_shown = rows_shown[:: max(1, len(rows_shown) // self.settings.among)]
        means = torch.nan_to_num(self.linear.gaussians.means)
        for rows in torch.nonzero(~shown)[:, 0].split(ROWS) if len(rows_shown) else ():
            apart = torch.cdist(means[rows], means[rows_shown])
            near = rows_shown[apart.topk(min(self.settings.neighbours, len(rows_shown)), largest=False).indices]
            local[rows] = total[near].sum(dim=1) / covered[near].sum(dim=1)
        share = self.settings.mean_share
        return torch.nan_to_num(share * mean + (1.0 - share) * local).clamp(min=1e-6)

    def around(self, viewpoint: Viewpoint) -> Tensor:
        """[H, W] variance of the sharp view in a window around each px, mean over the channels."""
        m, camera = self.linear.margin, viewpoint.camera
        frame = self.linear.unmoved(viewpoint)[:, m : m + camera.height, m : m + camera.width]
        mean, square = (_pooled(x, self.settings.window) for x in (frame, frame.square()))
        return torch.nan_to_num((square - mean.square()).clamp(min=0.0).mean(dim=0))


def _pooled(planes: Tensor, window: int) -> Tensor:
    return avg_pool2d(planes[None], window, 1, window // 2, count_include_pad=False)[0]


def passed(psf: PointSpread | None, frequencies: Tensor) -> Tensor:
    """Power that a blur lets through at frequencies (cycles/px), mean over directions; none beyond half a cycle."""
    grid = np.linspace(0.0, 0.5, 65)
    power = np.ones_like(grid)
    if psf is not None and not psf.is_identity:
        power = np.mean([np.abs(psf.mtf(grid, angle)) ** 2 for angle in (0.0, 45.0, 90.0, 135.0)], axis=0)
    return torch.from_numpy(np.interp(frequencies.numpy(), grid, power, right=0.0)).float()
