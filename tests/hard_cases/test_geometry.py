"""Hard cases: geometry. The cases themselves are in studies/stability/geometry.py."""

import pytest
from case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("geometry"))
def test_case(one, backend, holds):
    holds(one, backend)
