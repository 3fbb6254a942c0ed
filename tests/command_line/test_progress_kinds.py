"""Progress as JSON lines, as plain lines, as bars; and what signals do to it."""

import io
import json
import os
import signal

import pytest
from dgs.command_line.interruption import Interruption
from dgs.command_line.progress_bars import Bars
from dgs.command_line.progress_json import JsonLines
from dgs.command_line.progress_lines import Lines


def drive(progress) -> None:
    with progress:
        progress.stage("photos")
        progress.advance(3)
        progress.note("a note with [brackets] and ü")
        progress.stage("train", 100)
        for step in range(100):
            progress.advance(step + 1, loss=float("nan") if step == 0 else 1 / step, psnr=20.0)
        progress.finished({"twin": "out/twin.ply", "psnr": None})


def test_json_lines_are_objects_with_the_time_left():
    stream = io.StringIO()
    drive(JsonLines(stream, Interruption(), interval=0.0))
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert events[0] == {"event": "stage", "name": "photos", "total": None}
    training = [e for e in events if e["event"] == "advance" and e["stage"] == "train"]
    assert [e["done"] for e in training] == list(range(1, 101))
    assert training[0]["loss"] is None and training[1]["loss"] == 1.0
    assert training[-1]["seconds_left"] == 0 and training[50]["total"] == 100
    assert {"event": "note", "text": "a note with [brackets] and ü"} in events
    assert events[-1] == {"event": "done", "result": {"twin": "out/twin.ply", "psnr": None}}


def test_json_lines_are_not_too_many_but_the_last_comes():
    stream = io.StringIO()
    drive(JsonLines(stream, Interruption(), interval=1000.0))
    training = [json.loads(line) for line in stream.getvalue().splitlines() if '"stage": "train"' in line]
    assert [e["done"] for e in training] == [1, 100]


def test_errors_are_events():
    stream = io.StringIO()
    JsonLines(stream, Interruption()).failed("no photos", 2)
    assert json.loads(stream.getvalue()) == {"event": "error", "text": "no photos", "status": 2}


def test_figures_cannot_overwrite_the_fields_that_readers_rely_on():
    stream = io.StringIO()
    progress = JsonLines(stream, Interruption())
    progress.stage("train", 2)
    progress.advance(1, total=7.0)
    assert json.loads(stream.getvalue().splitlines()[-1])["total"] == 2


def test_plain_lines_and_silence():
    stream, results = io.StringIO(), io.StringIO()
    drive(Lines(stream, results, Interruption()))
    assert stream.getvalue().splitlines() == ["photos", "  note: a note with [brackets] and ü", "train (100)"]
    assert results.getvalue().split() == ["twin", "out/twin.ply"]
    results = io.StringIO()
    drive(Lines(None, results, Interruption()))
    assert results.getvalue() == ""


def test_bars_show_stages_notes_and_results(capsys):
    drive(Bars(Interruption()))
    captured = capsys.readouterr()
    assert "train" in captured.err and "100/100" in captured.err and "[brackets]" in captured.err
    assert "out/twin.ply" in captured.out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_stops(number):
    before = signal.getsignal(number)
    interruption = Interruption()
    with interruption:
        assert not JsonLines(io.StringIO(), interruption).cancelled()
        os.kill(os.getpid(), number)
        assert JsonLines(io.StringIO(), interruption).cancelled()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before
