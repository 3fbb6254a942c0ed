"""Hard cases: psf. The cases themselves are in studies/stability/psf.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("psf"))
def test_case(one, backend, holds):
    holds(one, backend)
