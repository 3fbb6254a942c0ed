"""The cases of `studies.stability` as tests, on every back end that is here."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from dgs.studies.stability.case import Case, measured


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
