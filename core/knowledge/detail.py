"""How fine a surface is seen: the share of its detail that a photo tells through the blur, octave by octave.

Locally a surface is taken for a picture whose contrast has the same variance in every octave, as natural pictures have.
Then Fisher's information through the blur is diagonal in the frequencies, neighbours' couplings included: of the
variance P(f) of a frequency f, a photo with noise n whose blur passes the power M^2(f) tells the share

    P M^2 / (P M^2 + n^2),   P = v / (1.5 pi f^2),   v the variance of the octave, 1.5 pi f^2 its area [1/px^2]

f in the photo's own px: who stands farther off, or aslant, sees the same detail at a higher frequency or on fewer px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..constants import SH_C0
from ..imaging.psf import PointSpread
from ..rasterizer import render
from .looks import Looks, Place

#: Middles of the octaves, cycles per px of the views that are wanted: from half a cycle, all that a px can show, down
#: to detail of 30 px, which the twin gets right from any photo.
OCTAVES = (0.36, 0.18, 0.09, 0.045)
#: Angles (radians) after which what a photo told of an octave is mostly open again, fine octaves first.
TURNS = tuple(float(np.radians(degrees)) for degrees in (25.0, 30.0, 35.0, 45.0))
#: Side (px) of the window in which the contrast around a px is taken: about two periods of the middle octaves.
WINDOW = 7
#: How much of the contrast is the scene's mean, the rest what photos show at the place: what looks plain may not be.
MEAN_SHARE = 0.1
#: What no photo shows is taken for like the nearest of what they show: so many neighbours, among so many Gaussians.
NEIGHBOURS, AMONG = 8, 2000
#: Rows of a table of distances at a time.
ROWS = 4096
#: A Gaussian that covers less than this many px of all photos together is not seen.
LEAST_SEEN = 0.05
#: With so many px of all photos together, its own contrast counts.
SHOWN = 1.0


class Detail:
    """What photos tell of the Gaussians' detail.

    Args:
        looks: at the twin; noise: standard deviation of a photo's px, sRGB.
        wanted: places from which the twin may be looked at: their px say what detail is.
        photos: that are there, whose contrast is the measure.
    """

    def __init__(self, looks: Looks, noise: float, wanted: Sequence[Place], photos: Sequence[Place]) -> None:
        self.looks, self.noise = looks, noise
        plain = torch.zeros((len(looks.gaussians), 1, 3))  # (a black Gaussian's own colour would have no gradient)
        self._plain = replace(looks.gaussians, sh=plain)
        self._told: dict[int, tuple[Place, Tensor]] = {}
        self._seen: dict[int, tuple[Place, Tensor]] = {}
        sizes, pixels = torch.zeros(len(plain)), torch.zeros(len(plain))
        largest = torch.full((len(plain),), 1e-12)
        for place in wanted:
            size, pixel = self.seen(place), self.pixel(place)
            sizes, pixels = sizes + size, pixels + size * pixel
            largest = torch.maximum(largest, size * pixel**2)
        anywhere = torch.stack([self.pixel(place) for place in wanted]).mean(dim=0)
        self.largest, self.wanted_pixel = largest, torch.where(sizes > LEAST_SEEN, pixels / sizes, anywhere)
        self.variance = self._contrast(photos)

    def weights(self, place: Place, planes: Sequence[Tensor]) -> list[Tensor]:
        """[N] sum over the sharp view's px of each Gaussian's share times each of several [H, W] planes."""
        sh = self._plain.sh.clone().requires_grad_()
        image = render(replace(self._plain, sh=sh), place.camera, settings=self.looks.settings).image
        out = []
        for index, plane in enumerate(planes):
            upstream = (plane / 3.0).expand(3, *plane.shape).contiguous()
            (gradient,) = torch.autograd.grad(image, sh, upstream, retain_graph=index + 1 < len(planes))
            out.append(torch.nan_to_num(gradient[:, 0].sum(dim=1) / SH_C0, 0.0, 0.0, 0.0))
        return out

    def seen(self, place: Place) -> Tensor:
        """[N] px that each Gaussian covers in the sharp view; kept."""
        if id(place) not in self._seen:  # (the place is kept too, so that its id stays its own)
            ones = torch.ones((place.camera.height, place.camera.width))
            self._seen[id(place)] = place, self.weights(place, [ones])[0].clamp(min=0.0)
        return self._seen[id(place)][1]

    def rays(self, place: Place) -> tuple[Tensor, Tensor]:
        """[N, 3] unit vectors from the Gaussians to the camera, and [N] distances."""
        rays = torch.from_numpy(place.camera.centre).float() - self.looks.gaussians.means
        distance = rays.norm(dim=1).clamp(min=1e-12)
        return rays / distance[:, None], distance

    def pixel(self, place: Place) -> Tensor:
        """[N] size of a px of the place's at each Gaussian, in the scene's units."""
        return self.rays(place)[1] / float(place.camera.fx)

    def passed(self, place: Place) -> Tensor:
        """[N, octaves] power that the blur lets through; 0 for what is finer than the place's px."""
        frequencies = self._frequencies(place)
        return passed(place.psf, frequencies)

    def told(self, place: Place) -> Tensor:
        """[N, octaves] share of the variance that a photo there tells of what is seen from its side; kept."""
        if id(place) not in self._told:
            frequencies = self._frequencies(place)
            signal = self.variance[:, None] / len(OCTAVES) * passed(place.psf, frequencies)
            noise = 1.5 * np.pi * frequencies.square() * self.noise**2
            visible = (self.seen(place) * self.pixel(place) ** 2 / self.largest).clamp(max=1.0)
            share = signal / (signal + noise)
            self._told[id(place)] = place, torch.nan_to_num(visible[:, None] * share)
        return self._told[id(place)][1]

    def _frequencies(self, place: Place) -> Tensor:
        scale = self.pixel(place) / self.wanted_pixel.clamp(min=1e-12)
        return scale[:, None] * torch.tensor(OCTAVES)

    def _contrast(self, photos: Sequence[Place]) -> Tensor:
        """[N] variance of the colours around each Gaussian, as the twin shows them where the photos look."""
        total, covered = (torch.zeros(len(self.looks.gaussians)) for _ in range(2))
        for place in photos:
            top, bottom = self.weights(place, [self.around(place), torch.ones_like(self.around(place))])
            total, covered = total + top, covered + bottom
        mean = total.sum() / covered.sum().clamp(min=1e-9)
        shown = covered > SHOWN
        local = torch.where(shown, total / covered.clamp(min=LEAST_SEEN), mean)
        known = torch.nonzero(shown)[:, 0]
        known = known[:: max(1, len(known) // AMONG)]
        means = torch.nan_to_num(self.looks.gaussians.means)
        for rows in torch.nonzero(~shown)[:, 0].split(ROWS) if len(known) else ():
            apart = torch.cdist(means[rows], means[known])
            near = known[apart.topk(min(NEIGHBOURS, len(known)), largest=False).indices]
            local[rows] = total[near].sum(dim=1) / covered[near].sum(dim=1)
        return torch.nan_to_num(MEAN_SHARE * mean + (1.0 - MEAN_SHARE) * local).clamp(min=1e-6)

    def around(self, place: Place) -> Tensor:
        """[H, W] variance of the sharp view in a window around each px, mean over the channels."""
        m, camera = self.looks.margin, place.camera
        frame = self.looks.unmoved(place)[:, m : m + camera.height, m : m + camera.width]
        mean, square = (_pooled(x) for x in (frame, frame.square()))
        return torch.nan_to_num((square - mean.square()).clamp(min=0.0).mean(dim=0))


def _pooled(planes: Tensor) -> Tensor:
    return avg_pool2d(planes[None], WINDOW, 1, WINDOW // 2, count_include_pad=False)[0]


def passed(psf: PointSpread | None, frequencies: Tensor) -> Tensor:
    """Power that a blur lets through at frequencies (cycles/px), mean over directions; none beyond half a cycle."""
    grid = np.linspace(0.0, 0.5, 65)
    power = np.ones_like(grid)
    if psf is not None and not psf.is_identity:
        power = np.mean([np.abs(psf.mtf(grid, angle)) ** 2 for angle in (0.0, 45.0, 90.0, 135.0)], axis=0)
    return torch.from_numpy(np.interp(frequencies.numpy(), grid, power, right=0.0)).float()
