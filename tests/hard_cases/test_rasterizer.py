"""Hard cases: rasterizer. The cases themselves are in studies/stability/rasterizer.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("rasterizer"))
def test_case(one, backend, holds):
    holds(one, backend)
