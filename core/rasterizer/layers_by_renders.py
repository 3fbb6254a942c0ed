"""Layers of a view by distance, each rendered twice by a back end's own `render`: its colours, and what it covers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ..camera import Camera
from ..constants import SH_C0
from ..gaussians import Gaussians
from ..rendering import RasterSettings, Rendered, RenderedLayers, ScreenStatistics

#: A back end's own: see `core.devices.Backend.render`.
Render = Callable[[Gaussians, Camera, Tensor | None, Tensor | None, RasterSettings], Rendered]
#: Logit of what is not there: beneath any opacity that counts.
_GONE = -40.0


class _OfAll(ScreenStatistics):
    """What several renders of one frame say together: the first one's radii, and the sum of all gradients."""

    def __init__(self, screens: Sequence[ScreenStatistics]) -> None:
        self._all = tuple(screens)
        first = self._all[0]
        super().__init__(first.radius, first.culled, first.evaluations)

    @property  # type: ignore[override]
    def mean_gradient(self) -> Tensor | None:
        """[N, 2] px; see `ScreenStatistics`."""
        found = [screen.mean_gradient for screen in self._all if screen.mean_gradient is not None]
        return sum(found[1:], found[0]) if found else None

    @mean_gradient.setter
    def mean_gradient(self, value: Tensor | None) -> None:
        """Each render's own is filled, not this."""


def render_layers_by_renders(
    render: Render,
    gaussians: Gaussians,
    camera: Camera,
    place: Tensor,
    background: Tensor | None,
    settings: RasterSettings,
) -> RenderedLayers:
    """See `core.rasterizer.render_layers`."""
    view = render(gaussians, camera, background, None, settings)
    plain, at = replace(settings, depth=False), place.detach().cpu()
    numbers = _shown_in(at, view)
    layers: list[Tensor] = []
    screens = [view.screen]
    for k in numbers:
        off = (place - k).abs()
        share = torch.where(off < 1, 1 - off, torch.zeros_like(off))[:, None]
        there = ((at > k - 1) & (at < k + 2)).to(place.device)
        logits = torch.where(there, gaussians.opacity_logits, torch.full_like(gaussians.opacity_logits, _GONE))
        own = replace(gaussians, opacity_logits=logits)
        behind = background if not layers else None
        colours = render(replace(own, sh=_shared(gaussians.sh, share)), camera, behind, None, plain)
        covering = render(replace(own, sh=_covering(gaussians.sh, share)), camera, None, None, plain)
        covered = covering.image[:1] if layers else covering.image[:1] + (1 - covering.alpha)[None]
        layers.append(torch.cat([colours.image, covered]))
        screens += [colours.screen, covering.screen]
    whole = Rendered(view.image, view.alpha, None if view.depth is None else view.depth.detach(), _OfAll(screens))
    return RenderedLayers(numbers, torch.stack(layers), whole)


def _shown_in(place: Tensor, view: Rendered) -> tuple[int, ...]:
    """Which layers show anything that is seen; the farthest one where nothing is."""
    seen = place[view.screen.radius.cpu() > 0]
    return tuple(int(k) for k in torch.unique(torch.cat([seen.floor(), seen.ceil()])).tolist()) or (0,)


def _shared(sh: Tensor, share: Tensor) -> Tensor:
    """Harmonics of colours times a share [N, 1]: a colour is half a unit more than they add up to."""
    first = sh[:, :1] * share[:, None] + ((share - 1) * (0.5 / SH_C0))[:, None]
    return torch.cat([first, sh[:, 1:] * share[:, None]], dim=1) if sh.shape[1] > 1 else first


def _covering(sh: Tensor, share: Tensor) -> Tensor:
    """Harmonics [N, 1, 3] of a share [N, 1] as a grey."""
    return ((share - 0.5) / SH_C0)[:, None].expand(len(sh), 1, 3)
