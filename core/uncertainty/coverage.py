"""Which detail of which surface the photos resolve, seen from where: they cover triples of Gaussian, octave, direction.

    resolved(e) = sum over Gaussians k, octaves b of
                  W_ke v_k max over photos t of q_ktb exp(-(angle_k(t, e) / turn_b)^2)

W is how many px of a view e that may be wanted a Gaussian covers, v the contrast around it and q the share of its
octave that a photo resolves through the blur (`detail`): so the fall of the views' squared error is weighed, where
there is something to get wrong. The finer the octave, the less far what was resolved carries, because depths are never
exact. It grows less with every photo (it is submodular), so that choosing the best photo each time comes within 1 - 1/e
of the best choice of all (Nemhauser et al. 1978).

A twin of few photos cannot say what it misses (surfaces that nobody saw, in the wrong place). So a candidate
also counts by how far aside of all photos it stands, a little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..numbers import number
from .detail import Detail
from .linear_model import Viewpoint


@dataclass(frozen=True)
class CoverageSettings:
    """How candidates are scored."""

    distance_weight: float = number(
        0.3,
        "standard deviations over the candidates",
        "weight of the angle to the nearest photo beside the gain: of what a training with each candidate truly "
        "gained, the ranks' correlation was 0.44 without, 0.49 with 0.3, 0.50 with 0.6; a niche that only some sides "
        "show was found later with 0.6",
        "the truth of 8 twins of the synthetic scenes of benchmarks/next_view.py, seeds 10 to 12",
        "the whole choice only, seeds 0 to 4: distance alone is better on 2 of 4 scenes (docs/studies/next_view.md)",
    )
    sample: int = number(8000, "count", "Gaussians that stand for all; more change no order")


class Coverage:
    """What photos cover of what may be looked at.

    Args:
        detail: at the twin; wanted: viewpoints from which it may be looked at, such as all candidates.
        photos: viewpoints of those that are there.
        seed: of the sample of Gaussians.
    """

    def __init__(
        self,
        detail: Detail,
        wanted: Sequence[Viewpoint],
        photos: Sequence[Viewpoint] = (),
        seed: int = 0,
        settings: CoverageSettings = CoverageSettings(),
    ) -> None:
        self.detail, self.settings = detail, settings
        count = len(detail.variance)
        generator = torch.Generator().manual_seed(seed)
        self._rows = torch.randperm(count, generator=generator)[: settings.sample].sort().values
        self._towards = torch.stack([detail.rays(viewpoint)[0][self._rows] for viewpoint in wanted])
        size = torch.stack([detail.seen(viewpoint)[self._rows] for viewpoint in wanted])
        self._size = size * detail.variance[self._rows]
        self._left = torch.ones((len(wanted), len(self._rows), len(detail.settings.octaves)))
        self._middle = self._focus(size.sum(dim=0))
        self._photos: list[Tensor] = []
        for viewpoint in photos:
            self.take(viewpoint)

    def take(self, viewpoint: Viewpoint) -> None:
        """A photo there is taken."""
        self._left = torch.minimum(self._left, self._by(viewpoint))
        self._photos.append(self._direction(viewpoint))

    def gain(self, viewpoint: Viewpoint) -> float:
        """By how much one more photo there raises the share of the wanted detail that is resolved, at most 1."""
        fall = (self._left - torch.minimum(self._left, self._by(viewpoint))).mean(dim=2)
        return float((self._size * fall).sum() / self._size.sum().clamp(min=1e-12))

    def aside(self, viewpoint: Viewpoint) -> float:
        """Angle (radians) to the nearest photo, seen from the middle of the twin, times the share of px showing it."""
        here = self._direction(viewpoint)
        angles = [float(torch.arccos((here @ there).clamp(-1.0, 1.0))) for there in self._photos]
        shown = float(self.detail.seen(viewpoint).sum()) / (viewpoint.camera.height * viewpoint.camera.width)
        return min(angles, default=float(np.pi)) * min(shown, 1.0)

    def scores(self, viewpoints: Sequence[Viewpoint]) -> list[float]:
        """What candidates are worth beside each other; the best one is to be taken."""
        gains, asides = (np.array([f(viewpoint) for viewpoint in viewpoints]) for f in (self.gain, self.aside))
        total = _standard(gains) + self.settings.distance_weight * _standard(asides)
        return [float(score) for score in total]

    def _by(self, viewpoint: Viewpoint) -> Tensor:
        """[E, sample, octaves] share that a photo there leaves unresolved of what may be looked at."""
        towards = self.detail.rays(viewpoint)[0][self._rows]
        angle = torch.arccos((self._towards * towards).sum(dim=2).clamp(-1.0, 1.0))
        carried = torch.exp(-((angle[:, :, None] / self.detail.turns).square()))
        return 1.0 - self.detail.resolved(viewpoint)[self._rows] * carried

    def _direction(self, viewpoint: Viewpoint) -> Tensor:
        """[3] unit vector from the middle of the twin to the camera."""
        ray = torch.from_numpy(viewpoint.camera.centre).float() - self._middle
        return ray / ray.norm().clamp(min=1e-12)

    def _focus(self, size: Tensor) -> Tensor:
        """[3] median of the Gaussians' centres by the px they cover: walls far around do not move it."""
        means = self.detail.linear.gaussians.means[self._rows]
        if not len(means):
            return torch.zeros(3)
        order = means.argsort(dim=0)
        share = (size + 1e-9)[order].cumsum(dim=0)
        middle = (share < 0.5 * share[-1:]).sum(dim=0).clamp(max=len(means) - 1)
        return means[order[middle, torch.arange(3)], torch.arange(3)]


def _standard(values: np.ndarray) -> np.ndarray:
    values = np.nan_to_num(values)
    return np.asarray((values - values.mean()) / max(float(values.std()), 1e-12)) if len(values) else values
