"""Requests that nobody means end with one line. `python -m tools.hostile` sends two thousand more."""

import os
from pathlib import Path

import pytest
import torch
from dgs.command_line import main, run
from dgs.command_line.table import COMMANDS
from dgs.core.errors import PsfError
from dgs.core.imaging.psf_text import parse_psf
from dgs.studies.stability.fuzzed_state import write_twin
from dgs.tools.hostile import NUMBERS, all_requests, make_files

NAMES = [command.name for command in COMMANDS]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile")
    make_files(folder)
    return folder


def ends_with_a_line(arguments, capfd):
    assert run(arguments) == 2, arguments
    said = capfd.readouterr().err
    assert said.count("\n") == 1 and 10 < len(said) < 1000 and "bug" not in said, said
    return said


def test_requests_are_made_for_every_command_and_number(folder):
    made = [request.name for request in all_requests(folder)]
    assert {name.split()[0] for name in made} == set(NAMES) and len(made) > 1000
    for option in ("update --seed", "reconstruct --max-gaussians", "next-view --number", "stress --fuzz"):
        assert sum(name.startswith(f"{option} number") for name in made) == len(NUMBERS)


@pytest.mark.parametrize("kind", ["fifo", "loop", "device", "long name", "long path"])
def test_paths_that_cannot_be_meant_are_refused_before_any_work(kind, folder, capfd):
    """A pipe was waited for without end; a long name was called a bug."""
    chosen = [r for r in all_requests(folder) if r.name.endswith(kind) and r.name.split()[0] != "blend"]
    assert len(chosen) > 20
    for request in chosen:
        if not any(word in request.name for word in ("--psf", "--effects", "--candidates", "name.json")):
            ends_with_a_line(request.arguments, capfd)


@pytest.mark.parametrize("out", ["", ".", "..", "/"])
def test_a_folder_where_a_kernel_would_be_written(out, folder, capfd):
    """The empty name was a traceback."""
    words = ["measure-psf", str(folder / "photos" / "a.png"), "--out", out]
    assert "is a folder" in ends_with_a_line(words, capfd)


def test_what_the_system_refuses_is_no_bug(folder, capfd, monkeypatch):
    def refused(options, progress):
        open("/proc/self/mem/x", "rb").close()

    monkeypatch.setattr("dgs.command_line.doctor_command.doctor_command", refused)
    assert "'/proc/self/mem/x': not a directory" in ends_with_a_line(["doctor"], capfd)


@pytest.mark.parametrize(
    "file",
    [
        Path(main.__file__).parent / "gone.json",  # a part of this program
        Path(main.__file__).parents[1] / "core" / "errors.py" / "x",
        Path(torch.__file__).parent / "gone.so",
        Path("/tmp/dgs-made-by-ourselves/gone.npz"),  # only the program can expect it
    ],
)
def test_a_file_that_only_the_program_can_miss_is_a_bug(file, capfd, monkeypatch):
    def careless(options, progress):
        open(file, "rb").close()

    monkeypatch.setattr("dgs.command_line.doctor_command.doctor_command", careless)
    assert run(["doctor"]) == 1
    said = capfd.readouterr().err
    assert "Traceback" in said and "careless" in said and "A bug, please report it" in said


def test_what_a_user_gave_and_took_away_is_no_bug(tmp_path, capfd, monkeypatch):
    def late(options, progress):
        open(options.photos / "gone.png", "rb").close()

    monkeypatch.setattr("dgs.command_line.inspect_command.inspect_command", late)
    assert f"'{tmp_path}/gone.png': no such file" in ends_with_a_line(["inspect", str(tmp_path)], capfd)


@pytest.mark.parametrize(
    "words",
    [
        *(["next-view", "here", option, "9223372036854775808"] for option in ("--number", "--count", "--samples")),
        *(["reconstruct", "here", "--out", "out", option, "9" * 19] for option in ("--frames", "--max-gaussians")),
        *(["synthesize", "--out", "out", option, "inf"] for option in ("--exposure-drift", "--noise", "--full-well")),
        *(["synthesize", "--out", "out", option, "9" * 400] for option in ("--overscan", "--views", "--seed", "--fog")),
        ["compare", "here", "--out", "out", "--seeds", "9" * 19],
    ],
    ids=lambda words: words[0] + words[-2],
)
def test_numbers_that_no_memory_holds(words, folder, capfd):
    """They ended in tracebacks, or began to work for ever."""
    places = {"here": str(folder / "twin"), "out": str(folder / "out")}
    said = ends_with_a_line([places.get(word, word) for word in words], capfd)
    assert "at most" in said or "from 1 to" in said


@pytest.mark.parametrize("name", ["reconstruct", "resume", "cameras", "inspect", "estimate", "update", "next-view"])
def test_a_photo_whose_name_is_no_text_is_refused_by_every_command(name, tmp_path, capfd):
    """It was a traceback after the whole training."""
    write_twin(tmp_path)
    photos, twin, out = (str(tmp_path / part) for part in ("photos", "twin", "out"))
    (tmp_path / "photos" / os.fsdecode(b"b\xff.png")).write_bytes((tmp_path / "photos" / "b.png").read_bytes())
    made = ["reconstruct", photos, "--out", out, "--cameras", f"{twin}/cameras", "--preset", "draft"]
    words = {"reconstruct": made, "resume": [*made, "--resume"], "cameras": ["cameras", photos, "--out", out]}
    words |= {"inspect": ["inspect", photos], "estimate": ["estimate", photos], "update": ["update", twin, photos]}
    assert run(words.get(name, ["next-view", twin, "--photos", photos])) == 2
    said = capfd.readouterr().err
    assert "b\\udcff.png' is not UTF-8. Rename it" in said and "Traceback" not in said and "bug" not in said, said


def test_a_list_that_is_a_pipe_is_not_waited_for(tmp_path, capfd):
    os.mkfifo(tmp_path / "psf.json")
    base = ["reconstruct", str(tmp_path), "--out", str(tmp_path / "out"), "--psf", f"per-photo:{tmp_path / 'psf.json'}"]
    ends_with_a_line(base, capfd)


@pytest.mark.parametrize("text", ["gaussian:3" + "+path:2,0" * 2000, "gaussian:999+path:500,1", "x" * 10_000])
def test_point_spreads_that_would_take_minutes(text):
    with pytest.raises(PsfError):
        parse_psf(text)
