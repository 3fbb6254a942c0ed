"""A limit on memory: what is predicted stays below it, unless the run needs more; and how it is written."""

import argparse
from dataclasses import replace

import pytest
from dgs.command_line.arguments import size
from dgs.core.effort.model import memory
from dgs.core.effort.records import Work

WORK = Work(1000, 700.0, 0.7, 900, 100, 300, 25_000, False, False, True, True)


def test_a_limit_is_what_is_predicted_where_photos_would_take_more():
    whole = memory([], WORK).value
    assert whole > 8000
    assert 3000 < memory([], WORK, 4 * 10**9).value < 4000
    assert memory([], WORK, 10**12).value == whole


def test_less_than_what_cannot_be_on_disk_is_not_promised():
    least = memory([], WORK, 10**8).value
    assert 100 < least < 1000
    assert memory([], replace(WORK, photos=5000), 10**8).value == least  # however many photos
    assert memory([], replace(WORK, gaussians=10**6), 10**8).value > least + 1000


@pytest.mark.parametrize(("text", "bytes_"), [("4G", 4 * 10**9), ("1.5 gb", 15 * 10**8), ("800M", 8 * 10**8)])
def test_sizes(text, bytes_):
    assert size(text) == bytes_


@pytest.mark.parametrize("text", ["4", "G", "-1G", "0G", "4K", "9999999T", ""])
def test_what_is_no_size(text):
    with pytest.raises(argparse.ArgumentTypeError, match="no size"):
        size(text)
