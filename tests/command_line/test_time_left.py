"""The time left: right where the rate is steady, nothing where it would be a guess."""

import pytest
from dgs.command_line.time_left import TimeLeft


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def predictions(times, total, waits=()):
    """What is predicted at each of the times at which one step more is done."""
    clock = Clock()
    left = TimeLeft(clock=clock)
    left.begin(total)
    found = []
    for index, now in enumerate(times):
        if index in waits:
            left.wait(waits[index])
        clock.now = now
        found.append(left.after(index + 1))
    return found


def steady(count, step, start=0.0):
    return [start + step * (index + 1) for index in range(count)]


def test_a_steady_stage_is_predicted():
    times = steady(100, 0.5)
    found = predictions(times, 100)
    assert found[:4] == [None] * 4 and found[-1] == 0.0
    for now, value in list(zip(times, found, strict=True))[5:]:
        assert value == pytest.approx(times[-1] - now, abs=1e-6)


def test_what_comes_before_the_first_step_is_not_counted():
    """The library of the cameras starts and matches for a minute, then places photos quickly: no 1196 s."""
    found = predictions(steady(20, 0.8, start=60.0), 20)
    assert found[0] is None and max(value for value in found if value is not None) < 20 * 0.8


def test_a_rate_that_is_not_steady_is_not_believed():
    slower = [0.01 * index**3 for index in range(1, 30)]
    assert all(value is None for value in predictions(slower, 200)[4:])
    stop = [*steady(5, 0.5), 40.0, 40.5]
    assert predictions(stop, 100)[-2:] == [None, None]


def test_a_stage_that_ends_at_once_says_nothing():
    assert predictions(steady(10, 0.01), 11) == [None] * 10


def test_steps_that_cannot_be_counted_have_no_end():
    left = TimeLeft()
    left.begin(None)
    assert [left.after(done) for done in range(10)] == [None] * 10


def test_another_attempt_is_measured_anew():
    clock = Clock()
    left = TimeLeft(clock=clock)
    left.begin(50)
    for done in range(1, 20):
        clock.now += 0.5
        left.after(done)
    assert left.after(20) is not None
    clock.now += 30.0
    assert left.after(1) is None
    for done in range(2, 30):
        clock.now += 1.0
        value = left.after(done)
    assert value == pytest.approx(21.0)


def test_a_pause_is_no_work():
    times = [*steady(10, 1.0), *steady(10, 1.0, start=110.0)]
    assert predictions(times, 40, waits={10: 100.0})[-1] == pytest.approx(20.0)
