"""The medium's blur as a linear operator with its adjoint, evaluated the way that measured fastest on this machine."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

from ..compiled import threads
from ..devices import backend_on
from ..errors import PsfError
from ..frames import Evaluation, Frame, PartialAdjoint, RowEvaluation
from ..numbers import number
from .choices import choice
from .evaluations import candidates
from .psf import PointSpread

#: What an evaluation may be asked for by.
EVALUATIONS = ("auto", "direct", "separable", "fourier", "reduced", "runs")


@dataclass(frozen=True)
class ChoiceSettings:
    """Numbers of the choice between evaluations of a blur."""

    wide: float = number(
        10.0,
        "px",
        "standard deviation from which on 'auto' may take the reduced resolution, which is off by up to 1e-4 where the"
        " others agree to 1e-6",
    )
    reduced_share: float = number(
        0.5,
        "share of the fastest exact one's time",
        "that the reduced resolution may take at most to be worth its error",
    )
    repeats: int = number(3, "count", "measurements of each, of which the best counts, after one that compiles")


CHOICE = ChoiceSettings()


class BlurOperator:
    """Maps a rendered frame with a margin to what the medium lets the camera see of it.

    Args:
        psf: the point spread; None or sigma 0 only crops the margin.
        height, width: the photo's size in px.
        margin: px that the rendered frame is larger on each side; beyond it the frame's edge is
            repeated. A margin of `psf.radius` makes borders exact.
        dtype: float32 or float64, of every tensor that comes in.
        evaluation: 'auto' takes 'runs' where the kernel has them, else the one that measured fastest, once per
            machine (see `choices`), so that the same job takes the same one every time; a name forces one.

    Raises:
        PsfError: the PSF is wider than the photo, or the forced evaluation does not fit it.
    """

    def __init__(
        self,
        psf: PointSpread | None,
        height: int,
        width: int,
        margin: int = 0,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        evaluation: str = "auto",
    ) -> None:
        if evaluation not in EVALUATIONS:
            raise ValueError(f"evaluation is one of {', '.join(EVALUATIONS)}, not '{evaluation}'")
        self.psf = psf
        self.frame = Frame(height, width, margin)
        self._evaluation: Evaluation | None = None
        if psf is None or psf.is_identity:
            return
        widest = float(max(psf.covariance[0, 0], psf.covariance[1, 1])) ** 0.5
        if widest > min(height, width) / 2:
            raise PsfError(
                f"The PSF '{psf.source or psf.kind}' has a standard deviation of {widest:.1f} px "
                f"on photos of {width} x {height} px: nothing of the scene would be left",
                "Give the PSF in pixels of the photos, or use larger photos",
            )
        found = candidates(psf, self.frame, dtype, torch.device(device))
        if evaluation == "auto":
            evaluation = self._measured(found, torch.device(device), dtype)
        if evaluation not in found:
            raise PsfError(
                f"The evaluation '{evaluation}' does not fit the PSF '{psf.source or psf.kind}'",
                f"Choose one of auto, {', '.join(found)}",
            )
        self._evaluation = found[evaluation]

    @property
    def evaluation(self) -> str:
        """How it is computed: 'identity', 'direct', 'separable', 'fourier', 'reduced' or 'runs'."""
        return "identity" if self._evaluation is None else self._evaluation.name

    def apply(self, frame: Tensor) -> Tensor:
        """[C, H + 2m, W + 2m] -> [C, H, W]; without gradient. Without a PSF a view of `frame` itself."""
        self._check(frame, self.frame.rendered)
        if self._evaluation is not None:
            return self._evaluation.apply(frame.detach())
        m = self.frame.margin
        return frame if m == 0 else frame[:, m:-m, m:-m]

    def apply_rows(self, frame: Tensor, rows: range) -> Tensor:
        """[C, R, W] some rows of `apply(frame)`; sooner where the evaluation computes each row by itself."""
        self._check(frame, self.frame.rendered)
        if isinstance(self._evaluation, RowEvaluation):
            return self._evaluation.apply_rows(frame.detach(), rows)
        return self.apply(frame)[:, rows.start : rows.stop : rows.step]

    def adjoint(self, photo: Tensor) -> Tensor:
        """[C, H, W] -> [C, H + 2m, W + 2m], the transpose of `apply`; without gradient."""
        self._check(photo, (self.frame.height, self.frame.width))
        if self._evaluation is not None:
            return self._evaluation.adjoint(photo.detach())
        m = self.frame.margin
        return photo if m == 0 else torch.nn.functional.pad(photo, (m, m, m, m))

    @property
    def partial(self) -> bool:
        """Whether `adjoint_at` costs less than `adjoint`."""
        return isinstance(self._evaluation, PartialAdjoint)

    def adjoint_at(self, photo: Tensor, wanted: Tensor) -> Tensor:
        """`adjoint` where `wanted` [H + 2m, W + 2m] is true, sooner where that can be; elsewhere it may be anything."""
        if not isinstance(self._evaluation, PartialAdjoint):
            return self.adjoint(photo)
        self._check(photo, (self.frame.height, self.frame.width))
        return self._evaluation.adjoint_at(photo.detach(), wanted)

    def __call__(self, frame: Tensor) -> Tensor:
        """`apply` with gradients; the very same tensor where there is neither PSF nor margin."""
        if self._evaluation is None:
            return self.apply(frame)
        blurred: Tensor = _Blur.apply(frame, self)
        return blurred

    def _check(self, tensor: Tensor, size: tuple[int, int]) -> None:
        if tensor.ndim != 3 or tuple(tensor.shape[1:]) != size:
            raise ValueError(f"expected [C, {size[0]}, {size[1]}], got {list(tensor.shape)}")

    def _measured(self, found: dict[str, Evaluation], device: torch.device, dtype: torch.dtype) -> str:
        assert self.psf is not None
        if "runs" in found:  # about as fast as any on a full frame, and by far the fastest on one that is nearly empty
            return "runs"
        wide = min(self.psf.sigma_x, self.psf.sigma_y) >= CHOICE.wide
        offered = {name: found[name] for name in found if name != "reduced" or wide}

        def measure() -> str:
            frame = torch.rand((3, *self.frame.rendered), device=device, dtype=dtype)
            taken = {name: _seconds(offered[name], frame) for name in offered}
            exact = min((name for name in taken if name != "reduced"), key=lambda name: taken[name])
            return "reduced" if taken.get("reduced", taken[exact]) < CHOICE.reduced_share * taken[exact] else exact

        kernel = self.psf.kernel()
        # Sampled kernels take the time of their size: photos with one each are not measured one by one.
        size = f"samples within {_rounded(kernel.shape[0])} x {_rounded(kernel.shape[1])}".encode()
        return choice(
            kernel.tobytes() if self.psf.samples is None else size,
            self.frame,
            device,
            dtype,
            threads(),
            torch.get_num_threads(),
            names=list(offered),
            measure=measure,
        )


def _rounded(size: int) -> int:
    return -(-size // 8) * 8


def _seconds(evaluation: Evaluation, frame: Tensor) -> float:
    """Best of a few of one blur and its adjoint, after a call that compiles and plans."""
    best = float("inf")
    for repeat in range(1 + CHOICE.repeats):
        start = time.perf_counter()
        out = evaluation.adjoint(evaluation.apply(frame))
        backend_on(out.device).synchronize()
        if repeat > 0:
            best = min(best, time.perf_counter() - start)
    return best


class _Blur(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, frame: Tensor, operator: BlurOperator) -> Tensor:
        ctx.operator = operator
        return operator.apply(frame)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:  # type: ignore[override]
        return ctx.operator.adjoint(gradient), None


class _Spread:
    """A point spread that equals others of the same kernel."""

    def __init__(self, psf: PointSpread) -> None:
        self.psf, self.kernel = psf, psf.kernel().tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Spread) and self.kernel == other.kernel

    def __hash__(self) -> int:
        return hash(self.kernel)


@lru_cache(maxsize=16)
def _made(spread: _Spread | None, height: int, width: int, margin: int) -> BlurOperator:
    return BlurOperator(None if spread is None else spread.psf, height, width, margin)


def shared_operator(psf: PointSpread | None, height: int, width: int, margin: int = 0) -> BlurOperator:
    """The operator on the CPU, float32; views of one size and one point spread share it (it takes 10 ms to make)."""
    return _made(None if psf is None else _Spread(psf), height, width, margin)
