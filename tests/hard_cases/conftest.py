"""The cases of `studies.stability` as tests, on every back end that is here."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from dgs.studies.stability.case import Case, measured

sys.path.insert(0, str(Path(__file__).parent))  # for `case_rows`


@pytest.fixture
def holds() -> Callable[[Case, str], None]:
    """Measures one case and asserts that its error is within the tolerance."""

    def check(one: Case, backend: str) -> None:
        if backend == "cuda":
            from dgs.core.rasterizer.cuda import available

            if not available():
                pytest.skip("no CUDA device with a working gsplat on this machine")
        result = measured(one, backend)  # type: ignore[arg-type]
        assert not result.raised, result.raised
        assert result.error <= one.tolerance, (
            f"{one.invariant}: {result.error:.3g} > {one.tolerance:.3g} ({one.reason})"
        )

    return check
