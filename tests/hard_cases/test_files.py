"""Hard cases: files. The cases themselves are in studies/stability/files.py."""

import pytest
from dgs.tests.hard_cases.case_rows import rows


@pytest.mark.parametrize(("one", "backend"), rows("files"))
def test_case(one, backend, holds):
    holds(one, backend)
