"""How wrong a sharp view is expected to be, px by px: parts of known shape, whose sizes the held-out photos measure.

What the photos leave open of the colours (`posterior`, Fisher's information through the blur) is only one part of what
is wrong with a twin, and the smaller one: surfaces also lie in the wrong place, detail was never resolved, and what
stands behind was never seen. Each part predicts a variance of the sharp view's px AND of the view through the blur:

    colours    spread of the posterior's samples; blurred, each sample goes through the blur
    placed     |grad I|^2: a surface that is shifted by a px shows its own gradient; blurred, the blurred view's
    depth      the same times sin^2 of the angle to the nearest photo that saw it: depth errors show from aside
    detail     the contrast of the octaves that no photo resolved (`detail`); blurred, what of them passes the blur
    empty      where the twin shows nothing: the photos' own variance
    rest       the same everywhere

Their weights are those under which the held-out photos' residuals, seen through the blur, are most likely (each px
Gaussian with the weighed variance), drawn towards the usual ones by as much as `trust` patches would.
Truth is used nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from ..constants import SH_C0
from ..numbers import BY_DEFINITION, number
from .detail import Detail
from .information_gain import opened, spread
from .linear_model import LinearModel, Viewpoint
from .posterior import Posterior

PARTS = ("colours", "placed", "depth", "detail", "empty", "rest")


@dataclass(frozen=True)
class ExpectedErrorSettings:
    """How the parts are weighed."""

    usual_weights: tuple[float, ...] = number(
        (0.07, 0.5, 2.4, 0.1, 1.6, 0.1),
        "share, px^2, px^2, share, share, (1/100)^2",
        "of `PARTS`: under which the true errors of trained twins were most likely, about the medians; 'placed' and "
        "'depth' are px^2 of shift, 'rest' is of a step of 1/100",
        "the truth of 18 trainings of two synthetic scenes (uneven, niche; seeds 10 to 12)",
        "five scenes, seeds 0 to 4 (benchmarks/reliability.py): 82 % of tenths within a factor of 1.5; one real set",
    )
    trust: float = number(
        500.0,
        "patches",
        "of held-out photos that the usual weights count for: 300 to 1000 did equally well",
        "the same 18 trainings",
        "the same as the usual weights",
    )
    patch: int = number(3, "px", "residuals are averaged over patches: neighbours are wrong together and count once")
    rest: float = number(1e-4, "sRGB^2", "variance that 'rest' predicts with weight 1: a step of 1/100", BY_DEFINITION)
    rounds: int = number(100, "count", "of the fit: the weights have settled to a per cent")


DEFAULTS = ExpectedErrorSettings()


@dataclass(frozen=True)
class Shapes:
    """Variances that the parts of weight 1 predict at a viewpoint.

    Attributes:
        sharp: [parts, H, W] of the sharp view's px, sRGB^2, mean over the channels.
        photo: [parts, H, W] of the photo's px, through the blur.
    """

    sharp: Tensor
    photo: Tensor


class ExpectedError:
    """What a twin's views are expected to be wrong by.

    Args:
        detail: at the twin; posterior: what `taken`, the photos it was trained on, leave open.
        variance: of the photos' px, for where nothing stands.
    """

    def __init__(self, detail: Detail, posterior: Posterior, taken: Sequence[Viewpoint], variance: float) -> None:
        self.detail, self.posterior, self.taken, self.variance = detail, posterior, list(taken), variance
        self.weights = torch.tensor(DEFAULTS.usual_weights)
        self.patches = 0

    @property
    def _linear(self) -> LinearModel:
        return self.detail.linear

    def shapes(self, viewpoint: Viewpoint, spreads: tuple[Tensor, Tensor] | None = None) -> Shapes:
        """The parts at a viewpoint; `spreads` are those of `information_gain.spread` there, where they are at hand."""
        linear, camera = self._linear, viewpoint.camera
        m = linear.margin
        left, aside = self._unresolved(viewpoint)
        open_now = self.detail.variance[:, None] * left
        through = (open_now * self.detail.passed(viewpoint)).sum(dim=1)
        values, alpha = painted(linear, torch.stack([open_now.sum(dim=1), through, aside], dim=1), viewpoint)
        if spreads is None:
            spreads = spread(linear, opened(linear, self.posterior, self.taken, viewpoint), viewpoint)
        blurred, sharp = spreads
        inner = (slice(None), slice(m, m + camera.height), slice(m, m + camera.width))
        own, seen = steepness(linear.unmoved(viewpoint)[inner]), steepness(linear.photo(viewpoint))
        empty, rest = (1.0 - alpha) * self.variance, torch.full_like(alpha, DEFAULTS.rest)
        return Shapes(
            _finite([sharp[inner].mean(dim=0), own, own * values[2], values[0], empty, rest]),
            _finite([blurred.mean(dim=0), seen, seen * values[2], values[1], empty, rest]),
        )

    def fit(self, held: Sequence[tuple[Viewpoint, Tensor]]) -> None:
        """Weighs the parts by photos [3, H, W] that the twin was not trained on."""
        shapes, residuals = [], []
        for viewpoint, photo in held:
            error = (self._linear.photo(viewpoint) - photo).square().mean(dim=0)
            predicted = self.shapes(viewpoint).photo
            if viewpoint.valid is not None:
                error, predicted = error * viewpoint.valid, predicted * viewpoint.valid
            whole = _patches(torch.ones_like(error) if viewpoint.valid is None else viewpoint.valid.float()) > 0.99
            shapes.append(_patches(predicted)[:, whole])
            residuals.append(_patches(error)[whole])
        if residuals:
            self.patches = sum(len(r) for r in residuals)
            self.weights = weighed(torch.cat(shapes, dim=1), torch.cat(residuals))

    def deviation(self, viewpoint: Viewpoint, spreads: tuple[Tensor, Tensor] | None = None) -> Tensor:
        """[H, W] expected root mean square error of the sharp view's px, sRGB."""
        return torch.einsum("k,khw->hw", self.weights, self.shapes(viewpoint, spreads).sharp).sqrt()

    def view(self, viewpoint: Viewpoint) -> tuple[Tensor, Tensor]:
        """[3, H, W] what the twin shows there, sharp, and [H, W] `deviation`."""
        m, camera = self._linear.margin, viewpoint.camera
        sharp = self._linear.unmoved(viewpoint)[:, m : m + camera.height, m : m + camera.width]
        return sharp, self.deviation(viewpoint)

    def _unresolved(self, viewpoint: Viewpoint) -> tuple[Tensor, Tensor]:
        """[N, octaves] share of the detail seen from here that no photo resolved; [N] sin^2 to the nearest."""
        here = self.detail.rays(viewpoint)[0]
        left, nearest = torch.ones((len(here), len(self.detail.octaves))), torch.zeros(len(here))
        for photo in self.taken:
            cosine = (here * self.detail.rays(photo)[0]).sum(dim=1).clamp(-1.0, 1.0)
            carried = torch.exp(-((torch.arccos(cosine)[:, None] / self.detail.turns).square()))
            left = torch.minimum(left, 1.0 - self.detail.resolved(photo) * carried)
            sees = self.detail.seen(photo) > self.detail.settings.minimum_seen
            nearest = torch.where(sees, torch.maximum(nearest, cosine), nearest)
        return left, 1.0 - nearest.square()


def weighed(shapes: Tensor, residuals: Tensor, trust: float = DEFAULTS.trust) -> Tensor:
    """Weights w >= 0 of [K, M] variances under which [M] squared residuals are most likely.

    Fixed points of w <- w sqrt((w sum c r / v^2 + t) / (w sum c / v + t w / w0)), v = sum w c: the likelihood's own
    multiplicative rule (Fevotte et al. 2009), with t patches that say w0.
    """
    usual = torch.tensor(DEFAULTS.usual_weights)
    weights = usual.clone()
    for _ in range(DEFAULTS.rounds):
        variance = (weights[:, None] * shapes).sum(dim=0).clamp(min=1e-9)
        raised = weights * (shapes * (residuals / variance.square())).sum(dim=1)
        lowered = weights * (shapes / variance).sum(dim=1)
        weights = weights * ((raised + trust) / (lowered + trust * weights / usual)).sqrt()
    return weights


def painted(linear: LinearModel, values: Tensor, viewpoint: Viewpoint) -> tuple[Tensor, Tensor]:
    """[C, H, W] means of the Gaussians' [N, C] values (>= 0) over what each px shows, and its [H, W] opacity."""
    planes, alpha = [], torch.zeros(())
    for first in range(0, values.shape[1], 3):
        three = pad(values[:, first : first + 3], (0, max(0, first + 3 - values.shape[1])))
        top = float(three.max()) if len(three) else 1.0
        sh = (three / max(top, 1e-12) - 0.5) / SH_C0
        with torch.no_grad():
            shown = linear.seen(viewpoint, sh[:, None, :])
        alpha = shown.alpha
        planes.append(shown.image * max(top, 1e-12) / alpha.clamp(min=1e-3))
    return torch.cat(planes)[: values.shape[1]], alpha


def steepness(picture: Tensor) -> Tensor:
    """[H, W] squared gradient of [3, H, W] per px^2, mean over the channels; the border repeats its neighbour."""
    framed = pad(picture[None], (1, 1, 1, 1), mode="replicate")[0]
    across = (framed[:, 1:-1, 2:] - framed[:, 1:-1, :-2]) / 2
    down = (framed[:, 2:, 1:-1] - framed[:, :-2, 1:-1]) / 2
    return (across.square() + down.square()).mean(dim=0)


def _patches(planes: Tensor) -> Tensor:
    """[..., H, W] -> [..., H / 3, W / 3] means."""
    side = DEFAULTS.patch
    batch = planes.reshape(1, -1, *planes.shape[-2:])
    return avg_pool2d(batch, side).reshape(*planes.shape[:-2], planes.shape[-2] // side, planes.shape[-1] // side)


def _finite(parts: list[Tensor]) -> Tensor:
    return torch.nan_to_num(torch.stack(parts), 0.0, 0.0, 0.0)
