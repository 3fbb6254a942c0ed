"""Where a twin is computed: what a back end can do, which ones there are, and which one a tensor belongs to.

A back end is one package or module of `core.backends` and one line of `REGISTRY`. To add one:

1. Write `core/backends/NAME.py` (or a package, for one with shaders or kernels of its own) with a class that has the
   members of `Backend`, and `BACKEND = ThatClass()` at its end. What it has no faster way for, it takes from
   `core.backends.reference.ReferenceBackend`, which is plain torch on any device and the specification of all of them.
2. Add its line to `REGISTRY`: its name (as `--device` takes it), its module, and torch's type of its tensors' device.

Renders, blurs, losses and Adam's steps then go to it wherever tensors are on that device; nothing else asks what a
device is. The hard cases (`stress --device NAME`) say whether it agrees with the others.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Protocol, SupportsFloat

from .errors import DeviceError

if TYPE_CHECKING:
    import torch
    from numpy.typing import NDArray
    from torch import Tensor

    from .camera import Camera
    from .frames import Evaluation, Frame
    from .gaussians import Gaussians
    from .rendering import RasterSettings, Rendered, RenderedLayers, RenderedPath

#: A back end's name: a key of `REGISTRY`, or 'auto'.
BackendName = str
#: r0, r1, f0, f1 of a weight max(0, min(r0 + r1 v, f0 + f1 v)) of a variance v.
Tent = tuple[float, float, float, float]


@dataclass(frozen=True)
class AdamStep:
    """One step of Adam (Kingma and Ba 2015) for one parameter.

    Attributes:
        values: [N, ...] changed in place; gradient: of the same shape; first, second: moments, changed in place.
        rate: step size over the first moment's bias correction, of the first `leading` values of each Gaussian.
        tail: the same of the others.
        leading: values of each Gaussian that `rate` is for; all if None.
        correction: 1 / sqrt of the second moment's bias correction.
        betas: decay of the moments; epsilon: added to the denominator.
        refused: [1] int32 on the same device, added to: gradients that were not finite, and moved nothing. It is a
            tensor, so that nobody has to wait for a card to know it.
    """

    values: Tensor
    gradient: Tensor
    first: Tensor
    second: Tensor
    rate: float
    tail: float
    leading: int | None
    correction: float
    betas: tuple[float, float]
    epsilon: float
    refused: Tensor


@dataclass(frozen=True)
class Missing:
    """What is missing in a render, as a photo has it (`core.training.loss.objective`), and how far it is believed.

    Attributes:
        values: [3, H + 2m, W + 2m]; they may be a part of a larger tensor.
        margin: m, px that the render is larger on every side than the photo.
        valid: [H, W] or [3, H, W] bool, which values of the photo count; None for all.
        width: w of the bounded difference d / sqrt(d^2 + w^2); 0 for its sign.
        weight: of the bounded difference.
        curve: where `values` are linear light: the render in sRGB and in linear light, and the least derivative of
            the decoding curve that they are divided by; None where they are sRGB.
    """

    values: Tensor
    margin: int
    valid: Tensor | None
    width: float
    weight: float
    curve: tuple[Tensor, Tensor, float] | None = None


@dataclass(frozen=True)
class LevelCurve:
    """What a photo's levels become with another exposure (`core.training.optics.exposures`). In the computer's memory.

    Attributes:
        table: [3, L] sRGB, of sRGB values k / (L - 1).
        white: [3] int64, the first level that the file may have clipped; black: [3] int64, the first that it has not.
        most: [3] sRGB, what may have been clipped to black is at most.
    """

    table: Tensor
    white: Tensor
    black: Tensor
    most: Tensor


@dataclass(frozen=True)
class Guarded:
    """What a check of all parameters found.

    Attributes:
        limited: Gaussians that were too large for their distance from the nearest camera; clamped: with a scale that
            the projection clamps; broken: whether any parameter is not finite.
    """

    limited: int
    clamped: int
    broken: bool


class Backend(Protocol):
    """What a training asks of a device. Tensors are float32 on the back end's own device unless said otherwise.

    Attributes:
        one_width: evaluation of a symmetric blur that suits frames of one size ('separable' or 'fourier').
        photo_bytes: photos of a set that may stay on the device from step to step; 0 where they are brought each time.
    """

    one_width: str
    photo_bytes: int

    def check(self) -> None:
        """Raises DeviceError, with the way out, where the back end cannot work on this machine."""
        ...

    def quick(self) -> bool:
        """Whether the device is made for such work, so that a training may be tried on it unasked.

        Loads nothing where it is plain that there is none; raises nothing.
        """
        ...

    def warm(self) -> None:
        """Does what the first step would wait for: drivers, shaders, libraries. Called on a thread of its own.

        Raises:
            DeviceError: the back end cannot work on this machine.
        """
        ...

    def synchronize(self) -> None:
        """Waits until everything asked for so far is done (for measuring times)."""
        ...

    def settled(self, tensor: Tensor) -> Tensor:
        """A tensor of the computer's memory on this device, brought there at once: it will be used again."""
        ...

    def render(
        self,
        gaussians: Gaussians,
        camera: Camera,
        background: Tensor | None,
        pose: Tensor | None,
        settings: RasterSettings,
    ) -> Rendered:
        """See `core.rasterizer.render`."""
        ...

    def render_path(
        self, gaussians: Gaussians, camera: Camera, background: Tensor | None, poses: Tensor, settings: RasterSettings
    ) -> RenderedPath:
        """See `core.rasterizer.render_path`."""
        ...

    def render_layers(
        self, gaussians: Gaussians, camera: Camera, place: Tensor, background: Tensor | None, settings: RasterSettings
    ) -> RenderedLayers:
        """See `core.rasterizer.render_layers`."""
        ...

    def surface_of_centres(self, gaussians: Gaussians, camera: Camera, settings: RasterSettings, held: float) -> Tensor:
        """[H, W] depth of the centre of the Gaussian at which a share of a px's light is held back; 0 where less is.

        See `core.rasterizer.surface_of_centres`; without gradient.
        """
        ...

    def blurs(
        self, kernel: NDArray, taps: tuple[NDArray, NDArray] | None, frame: Frame, dtype: torch.dtype
    ) -> dict[str, Evaluation]:
        """Evaluations of a blur by name, besides those in plain torch that every device has.

        Args:
            kernel: [K, L] float64; taps: (vertical, horizontal), odd and symmetric, where the kernel is their product.
            dtype: float32 or float64.
        """
        ...

    def photometric(
        self, image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float
    ) -> tuple[SupportsFloat, Tensor]:
        """Value and gradient [3, H, W] of MAE + SSIM between two [3, H, W] sRGB; see `core.training.loss.photometric`.

        To ask for the value's `float` may have to wait for the device.
        """
        ...

    def variation_gradient(self, image: Tensor, knee: float) -> Tensor:
        """See `core.training.loss.variation`."""
        ...

    def speck_gradient(self, image: Tensor) -> Tensor:
        """See `core.training.loss.specks`."""
        ...

    def add_variation(self, into: Tensor | None, image: Tensor, knee: float, weight: float) -> Tensor:
        """`weight` times `variation_gradient`, added to `into` in place; alone where that is None."""
        ...

    def add_specks(self, into: Tensor | None, image: Tensor, weight: float) -> Tensor:
        """`weight` times `speck_gradient`, added to `into` in place; alone where that is None."""
        ...

    def residual(
        self, photo: Tensor, blurred: Tensor, valid: Tensor | None, margin: int, size: tuple[int, int]
    ) -> Tensor:
        """[3, *size] photo less render, both [3, H, W], from row and column `margin` on; zero everywhere else.

        Args:
            valid: as of `Missing`; where a value does not count, or is not finite, it is zero, too.
        """
        ...

    def filter_colours(self, spectrum: Tensor, own: Tensor, shared: Tensor) -> Tensor:
        """`spectrum` [3, h, w] in place: each colour times `own`, plus the sum of all colours times `shared`.

        Args:
            own, shared: [h, w], real or complex.
        """
        ...

    def draw(self, gradient: Tensor, missing: Missing) -> None:
        """Subtracts the bounded difference from a gradient [3, H + 2m, W + 2m], in place, inside the photo."""
        ...

    def collect(self, centres: Tensor, radius: Tensor, gradients: Tensor, views: Tensor) -> None:
        """Adds up what one view shows of each Gaussian (`core.training.density.control`), in place.

        Args:
            centres: [N, 2] gradient in its projected centre; radius: [N] px, 0 where it is not seen.
            gradients: [N] lengths of them; views: [N] how many saw it.
        """
        ...

    def reexposed(self, photo: Tensor, shown: Tensor, curve: LevelCurve) -> Tensor:
        """[3, H, W] a photo through a curve; where it may be clipped no farther from `shown` than that allows."""
        ...

    def add_seen(
        self,
        sums: tuple[Tensor, Tensor, Tensor],
        gradient: Tensor,
        gaussians: Gaussians,
        camera: Camera,
        settings: RasterSettings,
    ) -> None:
        """Adds up what one photo sees of each Gaussian, in place (`core.training.density.contribution.SeenByPhotos`).

        Args:
            sums: [N] each: contribution, visibility, framed.
            gradient: [N, 1, 3] of a render's red channel, as far as it counts, in the first harmonics.
        """
        ...

    def guard(self, gaussians: Gaussians, centres: Tensor) -> Guarded:
        """Checks all parameters, and limits sizes in place (`core.training.guards`).

        Args:
            centres: [K, 3] of the cameras, in the Gaussians' world.
        """
        ...

    def adam(self, steps: Sequence[AdamStep]) -> None:
        """Makes the steps."""
        ...

    def layer_weighed(self, light: Tensor, variance: Tensor, tent: Tent) -> Tensor:
        """[C + 1, h, w] a layered blur's level's share of the light, and its weights; without gradient."""
        ...

    def layer_gathered(
        self, back: Tensor, light: Tensor, variance: Tensor, tent: Tent, gradients: tuple[Tensor, Tensor]
    ) -> None:
        """Adds a level's part to the gradients in the light [C, h, w] and in the variance [h, w].

        Args:
            back: [C + 1, h, w] what came back through the level's blur.
        """
        ...

    def layer_returned(
        self, together: Tensor, seen: Tensor | None, behind: tuple[Tensor, Tensor] | None, hides: Tensor
    ) -> Tensor:
        """[C + 1, h, w] what comes back to a level that hides others behind it, before its blur; the last one negative.

        Args:
            together: [C + 1, h, w] what comes back to all levels; seen: [h, w] share of this one that is (None: all).
            behind: planes [C + 1, h, w] of the next level that this one hides, and the share [h, w] of it that is seen.
            hides: [h, w] gradient in what the levels behind are covered by; this level's part is added.
        """
        ...


@dataclass(frozen=True)
class Entry:
    """A back end that there is.

    Attributes:
        load: makes it; imports what it needs.
        device: torch's type of the tensors that are its own; None where it is asked for by name only.
        unasked: whether 'auto' takes it wherever it works; others only where a training is quicker there
            (`core.pipeline.device`).
    """

    load: Callable[[], Backend]
    device: str | None
    unasked: bool = True


def _module(name: str) -> Callable[[], Backend]:
    """Loads core.backends.NAME when it is first asked for: torch, numba and a card's libraries take seconds."""

    def load() -> Backend:
        found: Backend = importlib.import_module(f".backends.{name}", __package__).BACKEND
        return found

    return load


#: All back ends, by the name that `--device` takes; 'auto' takes the last one that works and may be taken unasked.
REGISTRY: dict[BackendName, Entry] = {
    "reference": Entry(_module("reference"), None),
    "cpu": Entry(_module("cpu"), "cpu"),
    "gpu": Entry(_module("gpu.backend"), "gpu", unasked=False),
}


def devices() -> tuple[BackendName, ...]:
    """Names of the back ends that a run may be computed on."""
    return tuple(name for name, entry in REGISTRY.items() if entry.device is not None)


@cache
def _loaded(entry: Entry) -> Backend:
    return entry.load()


def backend_named(name: BackendName) -> Backend:
    """The back end of this name.

    Raises:
        DeviceError: there is none.
    """
    if name not in REGISTRY:
        raise DeviceError(f"There is no back end '{name}'", f"Choose one of {', '.join(REGISTRY)}")
    return _loaded(REGISTRY[name])


def tensors_on(name: BackendName) -> str:
    """Torch's device of the tensors that a back end takes; 'cpu' for those that are asked for by name only."""
    return REGISTRY[name].device or "cpu"


def backend_on(device: torch.device | str) -> Backend:
    """The back end whose tensors are on this device.

    Raises:
        DeviceError: no back end computes there.
    """
    kind = str(device).partition(":")[0]
    for entry in REGISTRY.values():
        if entry.device == kind:
            return _loaded(entry)
    raise DeviceError(f"No back end computes on the device '{device}'", f"Choose one of auto, {', '.join(devices())}")


def in_memory(part: Tensor) -> Tensor:
    """A part of an image in the computer's memory: of what lies on a card, no more comes than that."""
    return part if part.device.type == "cpu" else part.contiguous().cpu()


def all_in_memory(*parts: Tensor) -> list[Tensor]:
    """As `in_memory` each, of one dtype; from a card all at once, which is waited for once."""
    if all(part.device.type == "cpu" for part in parts):
        return list(parts)
    import torch  # heavy: torch

    together = torch.cat([part.reshape(-1) for part in parts]).cpu()
    ends = torch.split(together, [part.numel() for part in parts])
    return [values.reshape(part.shape) for values, part in zip(ends, parts, strict=True)]


def quick_devices() -> tuple[BackendName, ...]:
    """Devices that 'auto' may try a training on, though it does not take them everywhere."""
    return tuple(name for name in devices() if not REGISTRY[name].unasked and backend_named(name).quick())


def choose_device(asked: BackendName) -> BackendName:
    """The device to compute on: the one asked for, or for 'auto' the last of `REGISTRY` that works here
    and may be taken unasked.

    Raises:
        DeviceError: the one asked for does not exist, or does not work here.
    """
    if asked != "auto":
        if asked not in devices():
            raise DeviceError(f"There is no device '{asked}'", f"Choose one of auto, {', '.join(devices())}")
        backend_named(asked).check()
        return asked
    for name in reversed([name for name in devices() if REGISTRY[name].unasked]):
        try:
            backend_named(name).check()
        except DeviceError:
            continue
        return name
    raise DeviceError("No back end works on this machine", "Run 'doctor', which says why")
