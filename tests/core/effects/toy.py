"""A toy effect as docs/extending.md writes it: dust on the lens takes a share of all light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dgs.core.effects.spec import EffectSpec, EffectWords, Switch
from dgs.core.imaging.formation.effect import Effect, Shot
from dgs.core.inspection.evidence import Evidence, judged
from dgs.core.numbers import number

if TYPE_CHECKING:
    from dgs.core.inspection.photo_set import PhotoSet
    from torch import Tensor


@dataclass(frozen=True)
class DustSettings:
    """Numbers of the evidence for dust."""

    smallest_visible: float = number(0.05, "share", "of the light that is lost", "a toy")


SETTINGS = DustSettings()


class Dust(Effect):
    """light -> (1 - loss) light, loss []."""

    name = "dust"
    physics = "Grains on the front lens, far out of focus, cut off a share of all light."
    place = "sensor"

    def __init__(self, loss: Tensor) -> None:
        super().__init__({"loss": loss})

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        return (1.0 - self.parameters["loss"].to(light)) * light

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        self._add("loss", -(upstream * light).sum())
        return (1.0 - self.parameters["loss"].to(light)) * upstream

    def undone(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        return light / (1.0 - self.parameters["loss"].to(light))


def inspect(photos: PhotoSet) -> Evidence:
    """A white card would be needed to see it: the toy takes the mean of the photos for one."""
    import numpy as np  # late: the command line's help reads this file

    loss = 1.0 - float(np.mean([grey.mean() for grey in photos.greys]))
    text = f"The photos lack {100 * loss:.0f} % of full scale"
    return judged("dust", loss, 0.01, SETTINGS.smallest_visible, "share", text)


def build(photos: PhotoSet) -> Dust | None:
    """A tenth of what is missing."""
    import torch  # heavy

    return Dust(torch.tensor(0.1 * inspect(photos).estimate["value"]))


SPEC = EffectSpec(
    name="dust",
    physics=Dust.physics,
    words=EffectWords(
        label="Dust",
        tooltip="Grains on the lens that take a share of all light",
        simulated="Dust on the lens, undone on the photos before the training.",
        missing="Dust on the lens",
    ),
    inspect=inspect,
    switch=Switch(speakers=("dust",), trial_rank=8, simulation=Dust, build=build),
)
