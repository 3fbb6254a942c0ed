"""Other paths of a photo than its own, and whether they explain it better."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...camera import Camera
from ...devices import all_in_memory, in_memory
from ...imaging.formation.path_poses import way_on
from .coordinates import backwards
from .curved_ways import ShakenPhoto, curved_way
from .settings import CameraPathSettings
from .slopes import Sampled
from .straight_ways import explaining_ways

#: Places of a path that its way in the picture is read from.
_PLACES = 65


@dataclass(frozen=True)
class Rival:
    """A path that may take the place of a photo's own.

    Attributes:
        path: [M + 1, 6] twists; surely: standard errors by which it must explain the photo better.
    """

    path: Tensor
    surely: float


@dataclass(frozen=True)
class Shown:
    """A photo and what the twin shows of it without motion.

    Attributes:
        camera: of the photo, on the grid; photo, still: [3, H, W] sRGB; counts: [H, W] px that count, None for all.
        unit: distance of the scene.
    """

    camera: Camera
    photo: Tensor
    counts: Tensor | None
    still: Tensor
    unit: float

    @property
    def diagonal(self) -> float:
        """Px of the photo's diagonal."""
        return math.hypot(*self.photo.shape[1:])


def straight_rivals(shown: Shown, own: Tensor, exposures: float, settings: CameraPathSettings) -> list[Rival]:
    """Straight paths of other directions, and all, the photo's own too, the other way round: where a shutter rolls."""
    ways = explaining_ways(shown.still.cpu(), shown.photo.cpu(), settings.longest * shown.diagonal, settings)
    straight = []
    for x, y in ways:
        path = torch.zeros_like(own)
        path[0] = own[0]
        path[1, 4], path[1, 3] = x / shown.camera.fx / 2, -y / shown.camera.fx / 2
        straight.append(path * torch.tensor([1.0, *[exposures] * (len(own) - 1)])[:, None])
    paths = [backwards(own), *straight, *(backwards(path) for path in straight)]
    return [Rival(path, settings.clearly_nearer) for path in paths]


def curved_rivals(shown: Shown, own: Tensor, likely: NDArray[np.float64], settings: CameraPathSettings) -> list[Rival]:
    """The path that turns the camera along the curved way that explains a photo best, where that is not its own.

    Args:
        likely: [M + 1] standard deviations of a way's coefficients, px.
    """
    fx, longest = shown.camera.fx, settings.longest * shown.diagonal
    ways = explaining_ways(shown.still.cpu(), shown.photo.cpu(), longest, settings)
    before = np.polynomial.legendre.legfit(
        np.linspace(-1.0, 1.0, _PLACES), way_on(own, shown.unit, fx, _PLACES).double().numpy(), len(own) - 1
    ).T
    straight = math.hypot(*ways[0]) if ways else 2.0 * math.hypot(*before[:, 1])
    shaken = ShakenPhoto(shown.still, shown.photo, shown.counts, straight, likely, settings.independent)
    after = curved_way(shaken, before)
    if after is None:
        return []
    path, turned = torch.zeros_like(own), torch.from_numpy(after / fx).float()
    path[:, 4], path[:, 3] = turned[0], -turned[1]
    beside = torch.from_numpy((after - before)[:, 0] / fx).float()
    path[0] = own[0]
    path[0, 4] += beside[0]
    path[0, 3] -= beside[1]
    return [Rival(path, settings.nearer)]


def left_of(photo: Tensor, seen: Tensor, counts: Tensor | None, most: int) -> NDArray[np.float64]:
    """[h, w] mean sizes of what a path leaves of a photo [3, H, W] where a step looks at it; NaN where nothing counts.

    Args:
        seen: [3, H, W] what the twin shows in the photo; counts: [H, W] px that count; most: px that are looked at.
    """
    height, width = photo.shape[1:]
    at = Sampled.of(height, width, most)
    shown, expected = all_in_memory(at.of_planes(photo), at.of_planes(seen))
    rest = np.asarray((shown - expected).abs().mean(dim=0).numpy(), np.float64)
    return rest if counts is None else np.where(in_memory(at.of_planes(counts)).numpy(), rest, np.nan)


def nearer(own: NDArray[np.float64], other: NDArray[np.float64], part: int) -> float:
    """Standard errors by which another path leaves less of a photo; [h, w] as of `left_of`.

    Parts of `part` x `part` samples count as one each: neighbours err alike.
    """
    gain = own - other
    height, width = (max(1, length // part) for length in gain.shape)
    parts = [piece for rows in np.array_split(gain, height) for piece in np.array_split(rows, width, axis=1)]
    means = np.array([float(np.nanmean(piece)) for piece in parts if np.isfinite(piece).any()])
    if len(means) < 2:
        return 0.0
    return float(means.mean() / max(float(means.std(ddof=1)) / math.sqrt(len(means)), 1e-12))
