"""Hard cases: geometry. The cases themselves are in studies/stability/geometry.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("geometry"))
def test_case(one, backend, holds):
    holds(one, backend)
