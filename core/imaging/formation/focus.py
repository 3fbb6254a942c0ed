"""Blur that grows with the distance, in 1 / depth, from a sharp plane that each photo has for itself: an open lens.

    sigma(z) = strength |1 / z - focus|

A lens images one distance sharply, and a point elsewhere becomes a disk of diameter 4 sigma. What is near hides what is
behind it (`occluding`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from ...numbers import NOT_RECORDED, number
from .by_depth import DepthBlur, occlusion
from .effect import Shot

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class FocusSettings:
    """Numbers of a blur that grows with the distance from a sharp plane."""

    nearest_depth: float = number(
        0.02,
        "median depths",
        "what is nearer blurs as if it were here: a render's stray nearer px would blur without bounds",
        NOT_RECORDED,
        "no data: a guard",
    )
    off: float = number(
        0.5, "1 / median depth", "off the focus, where a blur is spoken of: most of a scene lies nearer to it"
    )
    reach: float = number(
        0.0055,
        "of the photo's diagonal",
        "standard deviation that light from beyond the border is kept for",
        "judgement",
    )


FOCUS = FocusSettings()

#: The counter (report.json) of a twin's Gaussians that every photo shows blurred, by a px or more.
OUT_OF_FOCUS = "in focus in no photo"


@dataclass(frozen=True)
class Focus:
    """One photo's: strength as a share of its diagonal, for 1 / depth in the unit of the render; focus as 1 / depth."""

    strength: float
    focus: float


class FocusBlur(DepthBlur):
    """Blurs each photo by depth.

    Args:
        names: of the photos; others pass unchanged.
        strengths, foci: [V], see `Focus`. unit: world's units of depth in one of the render's.
        errors: [V, 2] standard errors of both, 0 where unknown.
        shown: photos whose values something else than a twin shows: learning begins with them.
    """

    def __init__(
        self,
        names: Sequence[str],
        strengths: Tensor,
        foci: Tensor,
        unit: float = 1.0,
        errors: Tensor | None = None,
        shown: Iterable[str] = (),
    ) -> None:
        super().__init__({"strengths": strengths, "foci": foci})
        self.names, self.unit, self.shown = tuple(names), unit, frozenset(shown)
        self.errors = strengths.new_zeros(len(strengths), 2) if errors is None else errors
        self._rows = {name: i for i, name in enumerate(self.names)}

    @classmethod
    def unknown(cls, names: Sequence[str]) -> Self:
        """For these photos, without any strength yet."""
        return cls(names, *occlusion().unknown(len(names)))

    @classmethod
    def begun(cls, names: Sequence[str], shown: Mapping[str, Focus], unit: float) -> Self:
        """For these photos, with the values of those that are known, for depths in so many units of the world."""
        values = [shown.get(name, Focus(0.0, 1.0)) for name in names]
        columns = occlusion().columns([each.strength for each in values], [each.focus for each in values])
        return cls(names, columns[0], columns[1], unit, shown=shown)

    @staticmethod
    @abstractmethod
    def spread(strength: Tensor, focus: Tensor, depth: Tensor, diagonal: float) -> Tensor:
        """[h, w] signed standard deviation (px), positive in front of the sharp plane; differentiable.

        Args:
            strength, focus: [] of one photo; depth: [h, w] median depths; diagonal: of the photo, px.
        """

    def row_of(self, name: str) -> int | None:
        """Where a photo's parameters stand; None for a photo that passes unchanged."""
        return self._rows.get(name)

    def of(self, name: str) -> Focus | None:
        """A photo's values."""
        row = self.row_of(name)
        if row is None:
            return None
        return Focus(*(float(self.parameters[key][row].detach()) for key in ("strengths", "foci")))

    def alone(self, name: str, focus: Focus) -> Self:
        """The same effect for one photo only, with other values."""
        like = self.parameters["strengths"].detach()
        return type(self)([name], like.new_tensor([focus.strength]), like.new_tensor([focus.focus]), self.unit)

    def widest(self, name: str, diagonal: float) -> float:
        """Standard deviation (px of a photo of this diagonal) half a 1 / (median depth) off the focus."""
        row = self.row_of(name)
        return 0.0 if row is None else FOCUS.off * diagonal * float(self.parameters["strengths"][row])

    def reach(self, diagonal: float) -> float:
        """See `Effect`: one for all strengths, as frames keep their size while they are learned."""
        return FOCUS.reach * diagonal

    def scaled(self, factor: float) -> Self:
        """The same in a world that is `factor` times as large."""
        strengths, foci = (self.parameters[key].detach().clone() for key in ("strengths", "foci"))
        return type(self)(self.names, strengths, foci, self.unit * factor, self.errors.clone(), self.shown)

    def widths(self, values: Sequence[Tensor], depth: Tensor, row: int, shot: Shot) -> Tensor:
        """See `DepthBlur`; depth in median depths."""
        return self.spread(values[0][row].to(depth), values[1][row].to(depth), depth, shot.diagonal)

    def described(self) -> Mapping[str, object]:
        """The unit of depth, and by photo [strength, focus, their standard errors] (see `Focus`)."""
        values = [self.parameters[key].detach().cpu().double().tolist() for key in ("strengths", "foci")]
        errors = self.errors.cpu().double().tolist()
        rows = [[float(f"{v:.5g}") for v in (*pair, *error)] for *pair, error in zip(*values, errors, strict=True)]
        return {"unit": float(f"{self.unit:.6g}"), "photos": {name: rows[self._rows[name]] for name in self.names}}


class LensFocus(FocusBlur):
    """Each photo's own focus, by a lens."""

    name = "defocus"
    physics = "A lens images one distance sharply; its circle of confusion grows linearly in 1 / distance (thin lens)."
    shape = "disk"

    @staticmethod
    def spread(strength: Tensor, focus: Tensor, depth: Tensor, diagonal: float) -> Tensor:
        """See `FocusBlur`."""
        return strength * diagonal * (1.0 / depth.clamp(min=FOCUS.nearest_depth) - focus)
