"""The cases of `studies.stability` as tests, on every back end that is here."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from dgs.studies.stability.case import Case, measured
from dgs.tests.back_ends import or_skip


@pytest.fixture
def holds() -> Callable[[Case, str], None]:
    """Measures one case and asserts that its error is within the tolerance."""

    def check(one: Case, backend: str) -> None:
        or_skip(backend)
        result = measured(one, backend)  # type: ignore[arg-type]
        assert not result.raised, result.raised
        assert result.error <= one.tolerance, (
            f"{one.invariant}: {result.error:.3g} > {one.tolerance:.3g} ({one.reason})"
        )

    return check
