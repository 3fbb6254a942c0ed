"""Hard cases: loss. The cases themselves are in studies/stability/loss.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("loss"))
def test_case(one, backend, holds):
    holds(one, backend)
