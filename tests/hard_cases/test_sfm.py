"""Hard cases: sfm. The cases themselves are in studies/stability/sfm.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("sfm"))
def test_case(one, backend, holds):
    holds(one, backend)
