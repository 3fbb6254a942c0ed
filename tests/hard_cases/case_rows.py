"""A family's cases as pytest's parameters."""

from __future__ import annotations

import pytest
from dgs.studies.stability.registry import all_cases


def rows(family: str) -> list[object]:
    """Every case of a family with every back end that it concerns."""
    return [
        pytest.param(one, backend, id=f"{one.name}{'-' + backend if backend else ''}")
        for one in all_cases()
        if one.family == family
        for backend in (one.backends or ("",))
    ]
