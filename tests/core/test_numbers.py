"""Where the engine's numbers come from, and the page that says so."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from dgs.core.numbers import BY_DEFINITION, NOT_CHECKED, NOT_RECORDED, number, numbers_of
from dgs.tools import constants


@dataclass(frozen=True)
class Settings:
    width: float = number(2.5, "px", "wider finds more", "the ball", "three real sets")
    rounds: int = number(3, "count", "until nothing changes")
    half: float = number(0.5, "share", "the middle", BY_DEFINITION)
    name: str = "not a number"


def test_a_number_says_where_it_comes_from():
    found = {name: (value, origin.chosen_on, origin.checked_on) for name, value, origin in numbers_of(Settings)}
    assert found == {
        "width": (2.5, "the ball", "three real sets"),
        "rounds": (3, NOT_RECORDED, NOT_CHECKED),
        "half": (0.5, BY_DEFINITION, BY_DEFINITION),
    }
    with pytest.raises(ValueError, match="reason"):
        number(1, "px", "")


def test_the_page_is_what_the_code_says():
    assert constants.PAGE.read_text("utf-8") == constants.page(), "run make constants"


def test_the_page_has_every_number():
    assert sum(len(group.numbers) for group in constants.groups()) > 50
    shared = {name: reason for name, _, reason in constants.shared()}
    assert all(shared.values()) and "near" not in shared
    assert shared["FAR_PLANE"].startswith("Gaussians farther than this")
    assert shared["SH_C2"] == shared["SH_C0"]
