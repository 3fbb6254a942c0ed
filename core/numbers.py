"""How the numbers of an estimator say what they are: unit, reason, on which data chosen, on which checked.

An estimator keeps its numbers in one frozen dataclass; each field is made by `number`. docs/constants.md is written
from them (`make constants`). Numbers that forward and backward passes share are in `core.constants`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

#: Where a number was not chosen by data: it follows from a definition, from theory or from another number.
BY_DEFINITION = "by definition"
#: Where nobody wrote down what a number was chosen on.
NOT_RECORDED = "not recorded"
#: Where a number was never checked on data that it was not chosen on.
NOT_CHECKED = "not checked"

_KEY = "dgs number"


@dataclass(frozen=True)
class Provenance:
    """Where a number comes from.

    Attributes:
        unit: of its value ('px', 's', 'dB', 'share', 'count', ...).
        reason: why it is there, and what it does if it is larger or smaller.
        chosen_on: the data it was chosen on, `BY_DEFINITION` or `NOT_RECORDED`.
        checked_on: other data that it was checked on, or `NOT_CHECKED`.
    """

    unit: str
    reason: str
    chosen_on: str
    checked_on: str


def number(default: Any, unit: str, reason: str, chosen_on: str = NOT_RECORDED, checked_on: str = NOT_CHECKED) -> Any:
    """A dataclass field that carries where its default comes from; see `Provenance`."""
    if not unit or not reason:
        raise ValueError("A number needs a unit and a reason")
    checked = BY_DEFINITION if chosen_on == BY_DEFINITION and checked_on == NOT_CHECKED else checked_on
    return field(default=default, metadata={_KEY: Provenance(unit, reason, chosen_on, checked)})


def numbers_of(settings: type) -> Iterator[tuple[str, Any, Provenance]]:
    """Name, default and provenance of each documented number of a dataclass, in order."""
    for item in fields(settings):
        if _KEY in item.metadata:
            yield item.name, item.default, item.metadata[_KEY]
