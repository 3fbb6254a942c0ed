"""What a hard case is, how it is measured, and what measures share."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from torch import Tensor

from ...core.devices import BackendName, tensors_on
from ...core.errors import DgsError
from ...core.gaussians import Gaussians

Family = Literal["geometry", "rasterizer", "psf", "loss", "poses", "sfm", "scale", "files"]
#: In the order of the table.
FAMILIES: tuple[Family, ...] = ("geometry", "rasterizer", "psf", "loss", "poses", "sfm", "scale", "files")


@dataclass(frozen=True)
class Site:
    """Where a case is measured.

    Attributes:
        backend: of the rasterizer.
        folder: an empty folder for files.
    """

    backend: BackendName
    folder: Path

    @property
    def device(self) -> str:
        """The torch device of the back end's tensors."""
        return tensors_on(self.backend)

    def put(self, gaussians: Gaussians) -> Gaussians:
        """The Gaussians where the back end wants them."""
        return gaussians.to(device=self.device)


@dataclass(frozen=True)
class Case:
    """One hard case.

    Attributes:
        name: unique, a few words.
        family: which table it stands in.
        states: what happens, and how it fails elsewhere (one or two sentences).
        invariant: what must hold.
        tolerance: the largest error that counts as holding.
        reason: why that much.
        measure: gives the error (>= 0).
        backends: rasterizer back ends that it concerns; empty where it concerns none of them.
    """

    name: str
    family: Family
    states: str
    invariant: str
    tolerance: float
    reason: str
    measure: Callable[[Site], float]
    backends: tuple[BackendName, ...] = ()


@dataclass(frozen=True)
class Result:
    """What a case measured.

    Attributes:
        case: the case; backend: where, or '' where it concerns no back end.
        error: NaN where something was raised.
        seconds: wall time.
        raised: what was raised instead of a figure; empty if nothing.
    """

    case: Case
    backend: str
    error: float
    seconds: float
    raised: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance (NaN never is)."""
        return not self.raised and self.error <= self.case.tolerance


#: Every case of the files that were imported; see `registry.all_cases`.
CASES: list[Case] = []
#: Cases of the rasterizer run on all of these that are there.
ALL: tuple[BackendName, ...] = ("reference", "cpu", "gpu")


def case(
    family: Family, name: str, invariant: str, tolerance: float, reason: str, backends: tuple[BackendName, ...] = ()
) -> Callable[[Callable[[Site], float]], Callable[[Site], float]]:
    """Puts a function into the list of cases; its docstring says what happens."""

    def register(measure: Callable[[Site], float]) -> Callable[[Site], float]:
        states = " ".join((measure.__doc__ or "").split())
        CASES.append(Case(name, family, states, invariant, tolerance, reason, measure, backends))
        return measure

    return register


def backends_for(device: BackendName) -> tuple[BackendName, ...]:
    """Rasterizer back ends to measure where a device was chosen: those of every machine, and the device's own."""
    return tuple(name for name in ALL if name in ("reference", "cpu", device))


def measured(one: Case, backend: BackendName | Literal[""]) -> Result:
    """Runs a case; whatever it raises is a result, too."""
    began = time.perf_counter()
    error, raised = math.nan, ""
    with tempfile.TemporaryDirectory(prefix="dgs-case-") as folder:
        try:
            error = float(one.measure(Site(backend or "cpu", Path(folder))))
        except Exception as failure:  # noqa: BLE001 (a case that raises has failed, and the others go on)
            raised = f"{type(failure).__name__}: {' '.join(str(failure).split())[:200]}"
    return Result(one, backend, error, time.perf_counter() - began, raised)


def runs(cases: Sequence[Case], backends: Sequence[BackendName]) -> Iterator[tuple[Case, BackendName | Literal[""]]]:
    """Every case with every back end that it concerns."""
    for one in cases:
        for backend in [b for b in backends if b in one.backends] if one.backends else [""]:
            yield one, backend  # type: ignore[misc]


class Unexplained(Exception):
    """Something ended without the typed error that it should have ended with."""


@contextmanager
def explained(kind: type[DgsError] = DgsError) -> Iterator[None]:
    """The block must raise `kind` with a way out.

    Raises:
        Unexplained: it did not.
    """
    try:
        yield
    except kind as error:
        if not error.way_out:
            raise Unexplained(f"it names no way out: {error}") from error
        return
    raise Unexplained(f"no {kind.__name__} was raised")


def worst(found: Tensor, truth: Tensor) -> float:
    """Largest absolute difference; infinite where something is not finite, 0 where there is nothing."""
    if not bool(found.isfinite().all()):
        return math.inf
    difference = (found.double().cpu() - truth.double().cpu()).abs()
    return float(difference.max()) if difference.numel() else 0.0


def non_finite(*tensors: Tensor | None) -> int:
    """How many values are NaN or infinite."""
    return sum(int((~t.isfinite()).sum()) for t in tensors if t is not None)
