"""A photo's view of a twin as a linear map: steps of the parameters in, changes of the photo out, and back.

    apply:    dy = c H J x        adjoint:    x = c J' H' dy

The parameters are the Gaussians' mean colours, in units c of the prior; centres, shapes and opacities are held
fixed (how a surface may look different from another side is in `gain`). Blending is linear in colours, so J x is
the difference of two renders, J' comes from the rasterizer's gradients and H' from the blur's own adjoint.
Without a point spread H only crops the margin: what the photos determine without the medium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..camera import Camera
from ..constants import SH_C0
from ..forward import ForwardModel, kept_mediums, sharp_view
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.psf import PointSpread
from ..numbers import BY_DEFINITION, number
from ..rasterizer import RasterSettings, Rendered


@dataclass(frozen=True)
class PriorSettings:
    """What is assumed of a colour before any photo, and how its effect on a photo is computed."""

    colour: float = number(
        0.2, "sRGB in [0, 1]", "prior standard deviation of a colour: contrast of ordinary detail around its mean"
    )
    difference: float = number(
        0.01,
        "prior standard deviations",
        "step of the difference of two renders: small, so that few colours meet zero; far above float32's noise",
        BY_DEFINITION,
    )


PRIOR = PriorSettings()


@dataclass(frozen=True)
class Viewpoint:
    """Where a photo is or could be taken.

    Attributes:
        camera: on the grid, in the scene's own units.
        psf: point spread on that grid, None for none.
        valid: [H, W] bool, px that count; None for all.
    """

    camera: Camera
    psf: PointSpread | None
    valid: Tensor | None = None

    @property
    def name(self) -> str:
        """The camera's."""
        return self.camera.name


class LinearModel:
    """Linear maps of several viewpoints at one twin.

    Args:
        gaussians: in the scene's own units, float32 on the CPU.
        viewpoints: photos taken or to be taken.
        margin: grid px that renders are larger on each side.
        background: [3] sRGB.
        settings: low-pass of the rasterizer on this grid.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        viewpoints: Sequence[Viewpoint],
        margin: int,
        background: Tensor,
        settings: RasterSettings,
    ) -> None:
        self.gaussians, self.viewpoints = gaussians.detached(), list(viewpoints)
        self.margin, self.background, self.settings = margin, background, settings
        mediums = kept_mediums()
        self._model = ForwardModel(
            settings, lambda view: mediums(view.psf, Frame(view.camera.height, view.camera.width, margin)), margin
        )
        self._frames: dict[int, tuple[Viewpoint, Tensor]] = {}

    def blurred(self, frame: Tensor, viewpoint: Viewpoint) -> Tensor:
        """H: [3, H + 2m, W + 2m] frame, or change of it -> [3, H, W]."""
        return self._model.medium(viewpoint).degraded(frame)

    def frame(self, gaussians: Gaussians, viewpoint: Viewpoint) -> Tensor:
        """[3, H + 2m, W + 2m] the sharp frame."""
        return self._model.sharp(gaussians, viewpoint.camera, self.background).image

    def seen(self, viewpoint: Viewpoint, sh: Tensor) -> Rendered:
        """The sharp view, without a margin, of the twin in other colours [N, K, 3] on black; differentiable."""
        return sharp_view(replace(self.gaussians, sh=sh), viewpoint.camera, self.settings)

    def unmoved(self, viewpoint: Viewpoint) -> Tensor:
        """The twin's own sharp frame; kept."""
        if id(viewpoint) not in self._frames:  # (the viewpoint is kept too, so that its id stays its own)
            with torch.no_grad():
                self._frames[id(viewpoint)] = viewpoint, self.frame(self.gaussians, viewpoint)
        return self._frames[id(viewpoint)][1]

    def photo(self, viewpoint: Viewpoint) -> Tensor:
        """[3, H, W] what the viewpoint sees of the twin through the blur."""
        return self.blurred(self.unmoved(viewpoint), viewpoint)

    def sharp_change(self, step: Tensor, viewpoint: Viewpoint) -> Tensor:
        """c J x: [3, H + 2m, W + 2m] change of the sharp frame."""
        with torch.no_grad():
            sh = self.gaussians.sh.clone()
            sh[:, 0] += step * (PRIOR.difference * PRIOR.colour / SH_C0)
            moved = self.frame(replace(self.gaussians, sh=sh), viewpoint)
            return (moved - self.unmoved(viewpoint)) / PRIOR.difference

    def apply(self, step: Tensor, viewpoint: Viewpoint) -> Tensor:
        """H c J x: [3, H, W] change of the photo."""
        change = self.blurred(self.sharp_change(step, viewpoint), viewpoint)
        return change if viewpoint.valid is None else change * viewpoint.valid

    def adjoint(self, changes: Sequence[Tensor], viewpoint: Viewpoint) -> list[Tensor]:
        """c J' H' dy for each of several [3, H, W], from one render: [N, 3] each."""
        sh = self.gaussians.sh.clone().requires_grad_()
        image = self.frame(replace(self.gaussians, sh=sh), viewpoint)
        out = []
        for index, change in enumerate(changes):
            counted = change if viewpoint.valid is None else change * viewpoint.valid
            upstream = self._model.medium(viewpoint).gradient(counted.contiguous(), image).contiguous()
            (gradient,) = torch.autograd.grad(image, sh, upstream, retain_graph=index + 1 < len(changes))
            out.append(torch.nan_to_num(gradient[:, 0], 0.0, 0.0, 0.0) * (PRIOR.colour / SH_C0))
        return out

    def diagonal(self, viewpoints: Sequence[Viewpoint], generator: torch.Generator, probes: int = 1) -> Tensor:
        """[N, 3] diagonal of c^2 J' H' H J over `viewpoints`, by random signs (Hutchinson's probing of the root).

        For signs z: E[(c J' H' z)^2] is the diagonal; unbiased, with a relative error of about (2 / photos)^0.5.
        """
        total = torch.zeros((len(self.gaussians), 3))
        for viewpoint in viewpoints:
            shape = (3, viewpoint.camera.height, viewpoint.camera.width)
            signs = [torch.randint(0, 2, shape, generator=generator).float() * 2 - 1 for _ in range(probes)]
            for gradient in self.adjoint(signs, viewpoint):
                total += gradient.square() / probes
        return total
