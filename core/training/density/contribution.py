"""What the photos see of each Gaussian, and which Gaussians no photo needs.

Opacity says little about that: behind a surface, under a plate, in front of one camera alone, Gaussians stay as opaque
as they were at first, because no photo asks them for anything. They are the shreds that a new view finds. What counts
is a Gaussian's contribution: the weight with which it is blended, summed over the px of all photos (as the importance
of Fan et al. 2024, LightGaussian, and Fang and Wang 2024, Mini-Splatting, which add up the same weights). The room
that is won goes to where the photos ask for more.

A large Gaussian under a surface adds up a contribution all the same, out of the hundredth of its light that comes
through the cracks of what lies above. So it counts as well how much of itself is seen: its weights over the px that it
would cover with nothing before it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from ...camera import Camera
from ...constants import SH_C0
from ...devices import backend_on
from ...forward import sharp_view
from ...gaussians import Gaussians
from ...numbers import number
from ...rasterizer import RasterSettings, bare_footprints, with_gradient


@dataclass(frozen=True)
class ContributionSettings:
    """Numbers of what is asked, how often, and what follows."""

    least: float = number(
        0.15,
        "of the mean contribution",
        "a Gaussian with less is not needed by the photos",
        "lego at 400 px, 1000 steps: without 32.2 dB (worst view 27.6), 0.05 32.6 (28.8), 0.15 32.7 (29.5)",
        "copr at 400 px, sharp: without 30.8 dB (24.2), 0.15 30.9 (24.5), 0.4 28.5",
    )
    hidden: float = number(
        0.005,
        "of itself",
        "a Gaussian of which photos that have it in the frame see less, in the mean, lies hidden: its light comes"
        " through cracks, and a view from elsewhere finds it bare",
        "lego at 400 px, 1500 steps, 2 seeds: without 33.6 dB (worst view 29.8, 30.0), 0.005 33.6 (30.4, 30.6), 0.01"
        " 33.6 (30.5), 0.02 33.5 (30.4)",
        "village, room (3 seeds each), plant, orrery-front, copr, banana and brighton blurred: +0.2 to -0.1 dB, as"
        " seeds",
    )
    hidden_photos: int = number(
        80,
        "photos",
        "that hidden Gaussians are counted in at most: of more photos few may be the ones that see something",
        "the sets at hand have no more in a frame; no other value was tried",
    )
    price: float = number(
        0.1, "share of the run", "that asking may take: of large sets some photos are asked, evenly chosen"
    )
    step_price: float = number(
        0.5, "steps", "that asking one photo takes: it is rendered on the coarse grid, forwards and backwards"
    )
    most: int = number(
        12,
        "times",
        "that photos are asked in a run, however long: Gaussians added since have not grown into their places, and runs"
        " that ask on and on lose more than they add. As often as the balanced preset asks 16 photos",
        "no other value was compared; that a limit is needed was seen on the rendered village, 12,000 steps: asked 57"
        " times 29.6 dB, 6 times 34.2",
    )
    last: float = number(
        0.55,
        "share of the run",
        "at which the photos are asked for the last time: after it, density control still fills the room, and the rest"
        " closes what gaps are left",
        "lego at 400 px: 0.9 32.62 dB (worst view 29.16), 0.55 32.69 (29.34)",
        "copr blurred by 5 px: not asked 28.54 dB (23.9), 0.9 28.56 (24.0), 0.55 28.76 (25.0)",
    )


CONTRIBUTION = ContributionSettings()
#: Px that a footprint is divided by at least, where float32 has few digits left.
LEAST_FOOTPRINT = 1e-6


@dataclass
class SeenByPhotos:
    """What photos see of each Gaussian, summed over them.

    Attributes:
        contribution: [N] float32, px: its blending weights.
        visibility: [N] float32, photos: of each photo that has its centre in the frame the share of it that is blended;
            1 where nothing stands before it.
        framed: [N] float32, how many photos have its centre in the frame.
    """

    contribution: Tensor
    visibility: Tensor
    framed: Tensor

    @staticmethod
    def nothing(count: int, device: torch.device) -> SeenByPhotos:
        """Before any photo."""
        return SeenByPhotos(*(torch.zeros(count, device=device) for _ in range(3)))

    def sums(self) -> tuple[Tensor, Tensor, Tensor]:
        """All of them, to be added to."""
        return self.contribution, self.visibility, self.framed


def seen_by(
    gaussians: Gaussians, photos: Iterable[tuple[Camera, Tensor | None]], settings: RasterSettings
) -> SeenByPhotos:
    """What photos see of each Gaussian.

    Args:
        gaussians: in the cameras' world.
        photos: camera and [H, W] float32 weight of each px (None: all count); at least one.
    """
    # The derivative of one channel by a colour is the weight that the colour is blended with.
    colours = torch.zeros_like(gaussians.sh[:, :1]).requires_grad_()
    plain = gaussians.detached()
    plain.sh = colours
    found = SeenByPhotos.nothing(len(gaussians), gaussians.means.device)
    backend, whole = backend_on(gaussians.means.device), None
    for camera, weight in photos:
        colours.grad = None
        image = sharp_view(plain, camera, settings).image
        if weight is None and (whole is None or whole.shape != image.shape):
            whole = _red(image, None)  # (of photos of one size that count as a whole it is the same)
        upstream = whole if weight is None else _red(image, weight)
        assert upstream is not None
        with_gradient(image, upstream).backward()  # type: ignore[no-untyped-call]
        assert colours.grad is not None
        backend.add_seen(found.sums(), colours.grad, plain, camera, settings)
    return found


def _red(image: Tensor, weight: Tensor | None) -> Tensor:
    """[3, H, W] the gradient of a render's red channel, summed over the px that count."""
    upstream = torch.zeros(image.shape)
    upstream[0] = 1.0 if weight is None else weight.cpu()
    return upstream.to(image)


def add_seen_in_torch(
    sums: tuple[Tensor, Tensor, Tensor],
    gradient: Tensor,
    gaussians: Gaussians,
    camera: Camera,
    settings: RasterSettings,
) -> None:
    """See `core.devices.Backend.add_seen`: what every back end does, in plain torch."""
    contribution, visibility, framed = sums
    blended = gradient[:, 0, 0] / SH_C0
    bare = bare_footprints(gaussians, camera, settings).to(blended.device)
    contribution += blended
    visibility += torch.where(bare > 0, blended / bare.clamp(min=LEAST_FOOTPRINT), 0.0)
    framed += bare > 0


def needed(seen: SeenByPhotos) -> Tensor:
    """[N] bool: the Gaussians whose contribution is not next to nothing, and that do not lie hidden."""
    contributes = seen.contribution > CONTRIBUTION.least * seen.contribution.mean()
    hidden = seen.visibility <= CONTRIBUTION.hidden * seen.framed.clamp(max=CONTRIBUTION.hidden_photos)
    return contributes & ~(hidden & (seen.framed > 0))


def photos_asked(steps: int, photos: int) -> int:
    """How many of the photos a run of so many steps can afford to ask at a time."""
    return max(1, min(photos, int(CONTRIBUTION.price * steps / CONTRIBUTION.step_price)))


def times_asked(steps: int, photos: int) -> int:
    """How often a run of so many steps can afford to ask them."""
    afforded = int(CONTRIBUTION.price * steps / (CONTRIBUTION.step_price * photos_asked(steps, photos)))
    return min(max(1, afforded), CONTRIBUTION.most)


def asking(steps: int, photos: int) -> float:
    """Steps that a run could take instead of asking."""
    return CONTRIBUTION.step_price * photos_asked(steps, photos) * times_asked(steps, photos) if photos else 0.0


def due(share: float, steps: int, photos: int) -> int:
    """How often the photos should have been asked at a share in [0, 1] of the run."""
    times = times_asked(steps, photos)
    return min(times, int(share / CONTRIBUTION.last * times + 1e-9))
