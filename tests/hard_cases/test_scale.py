"""Hard cases: scale. The cases themselves are in studies/stability/scale.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("scale"))
def test_case(one, backend, holds):
    holds(one, backend)
