"""What lies between the light of a sharp view and one photo of it, on frames of one size.

`MediumModel` is what the forward model asks of it. Today's is `FixedMedium`: a given point spread. A medium that is
learned with the twin (a camera path for each exposure, defocus, a pane of frosted glass, a free kernel) is another
class with the same methods. It keeps parameters of its own, `gradient` adds to their gradients, and `sub_frames` may
ask for several renders for one photo, whose light is averaged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from ..camera import Camera
from ..colour import decoding_derivative, encoding_derivative, linear_to_srgb, srgb_to_linear
from ..frames import Frame
from ..imaging.medium import BlurSpace, Medium
from ..imaging.operator import BlurOperator, shared_operator
from ..imaging.psf import PointSpread


@dataclass(frozen=True)
class SubFrame:
    """One render of those whose light a photo collects.

    Attributes:
        camera: of the frame, margin included.
        pose: [3, 4] world to camera where it is to be learned, differentiable; None for the camera's own.
        weight: share of the photo's light; all of a photo's sum up to 1.
    """

    camera: Camera
    pose: Tensor | None = None
    weight: float = 1.0


class MediumModel(Protocol):
    """What the forward model asks of the medium in front of one photo.

    Attributes:
        space: in which light is averaged and blurred, 'srgb' or 'linear'.
    """

    space: BlurSpace

    def sub_frames(self, camera: Camera) -> Sequence[SubFrame]:
        """What is rendered for a photo whose frame, margin included, `camera` sees: at least one."""
        ...

    def degraded(self, image: Tensor) -> Tensor:
        """[3, H + 2m, W + 2m] sRGB light that reaches the medium -> [3, H, W] sRGB photo; without gradient."""
        ...

    def gradient(self, upstream: Tensor, image: Tensor) -> Tensor:
        """Gradient of a loss in `image`, given that in `degraded(image)`; adds those in parameters of its own."""
        ...


@dataclass(frozen=True)
class Passed:
    """An image on its way through the medium.

    Attributes:
        image: [3, H + 2m, W + 2m] sRGB; light: the same in the space in which the blur is linear.
        blurred: [3, H, W] in that space.
    """

    image: Tensor
    light: Tensor
    blurred: Tensor


class FixedMedium:
    """A given point spread, in sRGB values or in linear light.

    Args:
        blur: of frames of one size.
        space: 'srgb' blurs display values, 'linear' decodes, blurs and encodes again.
    """

    def __init__(self, blur: BlurOperator, space: BlurSpace = "srgb") -> None:
        self.blur, self.space = blur, space

    def sub_frames(self, camera: Camera) -> Sequence[SubFrame]:
        """See `MediumModel`: the camera stood still."""
        return (SubFrame(camera),)

    def decoded(self, image: Tensor) -> Tensor:
        """sRGB values in the space in which the blur is linear; the very same tensor where that is sRGB."""
        return image if self.space == "srgb" else srgb_to_linear(image)

    def encoded(self, light: Tensor) -> Tensor:
        """The inverse of `decoded`."""
        return light if self.space == "srgb" else linear_to_srgb(light)

    def passed(self, image: Tensor) -> Passed:
        """The image's way through the medium, which `pulled_back` takes back."""
        light = self.decoded(image)
        return Passed(image, light, self.blur.apply(light))

    def degraded(self, image: Tensor) -> Tensor:
        """See `MediumModel`."""
        return self.encoded(self.blur.apply(self.decoded(image)))

    def gradient(self, upstream: Tensor, image: Tensor) -> Tensor:
        """See `MediumModel`."""
        if self.space == "srgb":  # linear: it is the same at every image
            return self.blur.adjoint(upstream)
        passed = self.passed(image)
        return self.pulled_back(upstream, passed, self.encoded(passed.blurred))

    def pulled_back(self, upstream: Tensor, passed: Passed, degraded: Tensor, weight: float = 1.0) -> Tensor:
        """`gradient` where the image has passed before; `weight` times `upstream` [3, H, W], that in `degraded`."""
        if self.space == "srgb":
            return self.blur.adjoint(upstream if weight == 1.0 else upstream * weight)
        upstream = upstream * encoding_derivative(passed.blurred, degraded)
        return self.blur.adjoint(upstream * weight) * decoding_derivative(passed.image, passed.light)


def medium_of(
    psf: PointSpread | None,
    frame: Frame,
    space: BlurSpace = "srgb",
    device: torch.device | str = "cpu",
    dtype: torch.dtype = torch.float32,
    evaluation: str = "auto",
) -> FixedMedium:
    """The medium of one point spread on frames of one size, made anew; arguments as of `BlurOperator`."""
    blur = BlurOperator(psf, frame.height, frame.width, frame.margin, device, dtype, evaluation)
    return FixedMedium(blur, space)


def shared_medium(psf: PointSpread | None, frame: Frame, space: BlurSpace = "srgb") -> FixedMedium:
    """The same on the CPU in float32, where frames of one size and point spread share what is computed of it."""
    return FixedMedium(shared_operator(psf, frame.height, frame.width, frame.margin), space)


def kept_mediums() -> Callable[[PointSpread | None, Frame], FixedMedium]:
    """`shared_medium` for whoever comes back to many point spreads by turns: keeps all of them, as long as it lives."""
    kept: dict[tuple[Frame, bytes], FixedMedium] = {}

    def medium(psf: PointSpread | None, frame: Frame) -> FixedMedium:
        key = frame, b"" if psf is None else psf.kernel().tobytes()
        if key not in kept:
            kept[key] = medium_of(psf, frame)
        return kept[key]

    return medium


def space_of(medium: Medium) -> BlurSpace:
    """The space that a medium's photos pass: what blurs none need not be decoded."""
    return medium.blur_space if medium.blurs else "srgb"
