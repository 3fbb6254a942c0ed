"""Hard cases: poses. The cases themselves are in studies/stability/poses.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("poses"))
def test_case(one, backend, holds):
    holds(one, backend)
