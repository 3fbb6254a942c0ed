"""A blur whose width follows from the depth, with occlusion, and gradients in what it follows by and in the depth."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, ClassVar

from .effect import Effect, Shot

if TYPE_CHECKING:
    from torch import Tensor

    from .occluding import OccludingBlur, Shape


def occlusion() -> ModuleType:
    """The mathematics of it."""
    from . import occluding  # heavy: torch

    return occluding


class DepthBlur(Effect):
    """Blurs each photo by depth."""

    place = "light"
    by_depth = True
    by_surface = True
    shape: ClassVar[Shape]

    def __init__(self, parameters: dict[str, Tensor]) -> None:
        super().__init__(parameters)
        self.depth_gradient: Tensor | None = None
        self._last: tuple[Tensor, Shot, tuple[int, ...], OccludingBlur, Tensor] | None = None

    @abstractmethod
    def row_of(self, name: str) -> int | None:
        """Where a photo's parameters stand; None for a photo that passes unchanged."""

    @abstractmethod
    def widths(self, values: Sequence[Tensor], depth: Tensor, row: int, shot: Shot) -> Tensor:
        """[h, w] signed standard deviation (px), positive in front of the sharp plane; differentiable.

        Args:
            values: of the parameters, in their order; depth: [h, w] of the frame; row: of the parameters.
        """

    def width(self, light: Tensor, shot: Shot, row: int) -> Tensor:
        """[h, w] the same for a frame's light [3, h, w] as the parameters are."""
        if shot.depth is None:
            raise ValueError(f"{self.name} needs the render's depth")
        if shot.depth.shape != light.shape[1:]:
            raise ValueError(f"depth is of the light's own frame, not {list(shot.depth.shape)} for {list(light.shape)}")
        return self.widths(list(self.parameters.values()), shot.depth.to(light), row, shot)

    def _versions(self) -> tuple[int, ...]:
        return tuple(value._version for value in self.parameters.values())

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        row = self.row_of(shot.name)
        if row is None:
            return light
        blur = occlusion().OccludingBlur(self.width(light, shot, row), self.shape)
        out = blur.apply(light)
        # The gradient of the same step asks for the same again.
        self._last = None if out.requires_grad else (light, shot, self._versions(), blur, out)
        return out

    def rows(self, light: Tensor, shot: Shot, rows: range) -> Tensor:
        """[C, R, w] some rows of `forward(light, shot)`, without gradient."""
        row = self.row_of(shot.name)
        if row is None:
            return light[:, rows.start : rows.stop : rows.step]
        return occlusion().OccludingBlur(self.width(light, shot, row), self.shape).apply_rows(light, rows)

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`; leaves the gradient in the depth [h, w] in `depth_gradient`."""
        row, self.depth_gradient = self.row_of(shot.name), None
        if row is None:
            return upstream
        last = self._last
        if last is None or last[0] is not light or last[1] is not shot or last[2] != self._versions():
            self.forward(light, shot)
            last = self._last
        assert last is not None
        blur, out = last[3:]
        self._last = None
        passed, in_width = blur.adjoint(upstream, light, out)
        self._add_gradients(in_width, shot, light, row)
        return passed

    def _add_gradients(self, in_width: Tensor | None, shot: Shot, light: Tensor, row: int) -> None:
        wanted = list(self.parameters.values())
        if in_width is None:
            found = [value.new_zeros(value.shape) for value in wanted]
        else:
            assert shot.depth is not None

            def width(*values: Tensor) -> Tensor:
                return self.widths(values[:-1], values[-1], row, shot)

            given = [value.detach().to(light) for value in (*wanted, shot.depth)]
            *found, self.depth_gradient = occlusion().pulled_back(width, given, in_width)
        for (key, like), value in zip(self.parameters.items(), found, strict=True):
            self._add(key, value.to(like))
