"""Effects that blur every px by a width of its own; how it is done is in `layered`."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from .effect import Effect, Shot, radius2

if TYPE_CHECKING:
    from torch import Tensor

    from .layered import LayeredBlur


class SpreadingEffect(Effect):
    """An effect that blurs every px by a width of its own."""

    place = "light"

    def __init__(self, parameters: dict[str, Tensor]) -> None:
        super().__init__(parameters)
        self._last: tuple[Tensor, Shot, tuple[int, ...], LayeredBlur, Tensor] | None = None

    @abstractmethod
    def spread(self, depth: Tensor, r2: Tensor, diagonal: float) -> Tensor:
        """Variance (px^2), differentiable in the parameters.

        Args:
            depth: median depths, 1 where the effect does not go `by_depth`.
            r2: squared distance from the photo's middle over half its diagonal, 0 where it does.
            diagonal: of the photo, px.
        """

    def variance(self, shot: Shot, like: Tensor) -> Tensor:
        """[h, w] px^2 of the frame `like` [3, h, w]."""
        return self.spread(*self._where(shot, like), shot.diagonal)

    def _where(self, shot: Shot, like: Tensor) -> tuple[Tensor, Tensor]:
        if not self.by_depth:
            return like.new_ones(()), radius2(shot, like)
        if shot.depth is None:
            raise ValueError(f"{self.name} needs the render's depth")
        return shot.depth.to(like), like.new_zeros(())

    @abstractmethod
    def add_gradients(self, in_variance: Tensor | None, shot: Shot, light: Tensor) -> None:
        """Adds the parameters' gradients, given that in the variance; None where it changes nothing."""

    def _versions(self) -> tuple[int, ...]:
        return tuple(value._version for value in self.parameters.values())

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        from .layered import LayeredBlur  # heavy: torch

        blur = LayeredBlur(self.variance(shot, light))
        out = blur.apply(light)
        # The gradient of the same step asks for the same again.
        self._last = None if out.requires_grad else (light, shot, self._versions(), blur, out)
        return out

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        import torch  # heavy

        last = self._last
        if last is None or last[0] is not light or last[1] is not shot or last[2] != self._versions():
            with torch.no_grad():
                self.forward(light, shot)
            last = self._last
        assert last is not None
        blur, out = last[3:]
        self._last = None
        passed, in_variance = blur.adjoint(upstream, light, out)
        self.add_gradients(in_variance, shot, light)
        return passed
