"""The table of commands: every command is in it, explains itself, and finds a Python that can run it."""

import argparse
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import dgs
import pytest
from dgs.command_line import main, run
from dgs.command_line.table import COMMANDS, Command, command_of
from dgs.dgs_addon.engine.process import environment

ROOT = Path(dgs.__file__).parent
NAMES = [command.name for command in COMMANDS]


@pytest.fixture
def without_torch(monkeypatch):
    """As in Blender's own Python."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "torch" else find(name, *rest))


def test_every_command_file_is_in_the_table():
    files = {file.stem.removesuffix("_command") for file in (ROOT / "command_line").glob("*_command.py")}
    assert files == {name.replace("-", "_") for name in NAMES} and len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_command_has_help_and_a_handler(name, capsys):
    command = command_of([name, "--help"])
    assert command is not None and command.name == name and callable(command.handler())
    assert run([name, "--help"]) == 0
    shown = capsys.readouterr().out
    assert name in shown and len(shown.splitlines()) > 6
    assert run(["--help"]) == 0
    assert command.help in " ".join(capsys.readouterr().out.split())


def test_no_command_is_made_up():
    assert command_of([]) is None and command_of(["--version"]) is None and command_of(["photos", "render"]) is None


@pytest.mark.parametrize("name", NAMES)
def test_a_python_without_torch_hands_engine_work_over(name, without_torch):
    import run_dgs

    here = {"blend", "synthesize"}  # Blender's own Python is the one that can
    assert run_dgs.lacks_packages([name, "x"]) is (name not in here)
    assert not run_dgs.lacks_packages(["--help"])


@pytest.mark.parametrize("name", [command.name for command in COMMANDS if command.needs_engine])
def test_a_python_without_the_engine_says_what_to_use(name):
    """`-S` leaves out the installed packages, as a bare Python would."""
    done = subprocess.run(
        [sys.executable, "-S", str(ROOT / "run_dgs.py"), name, "x"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and "make setup" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("progress", [[], ["--progress", "json"]])
def test_who_chose_a_wrong_python_in_blender_is_sent_to_the_preferences(progress):
    """Nobody has a Makefile there; a job hears it as an event, a question as a line."""
    command = [sys.executable, "-S", str(ROOT / "run_dgs.py"), "reconstruct", "x", *progress]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment())
    words = json.loads(done.stdout)["text"] if progress else done.stderr
    assert done.returncode == 2 and "preferences" in words and "Install Engine" in words and "make" not in words


def test_a_blender_without_an_engine_says_one_sentence(tmp_path, monkeypatch, capsys):
    pytest.importorskip("bpy")
    from dgs.dgs_addon.engine.handover import hand_over

    monkeypatch.setenv("DGS_ENGINE_PYTHON", str(tmp_path / "nowhere"))
    assert hand_over(["reconstruct"]) == 2
    words = capsys.readouterr().err.strip()
    assert words.endswith("name an interpreter in DGS_ENGINE_PYTHON.") and not re.search(r"[.,]\s*[.,]", words), words


def test_a_new_command_is_a_file_and_a_line(monkeypatch, capsys):
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--times", type=int, default=1)

    def greet_command(options: argparse.Namespace, progress: object) -> int:
        print("hello " * options.times)
        return 0

    file = type(sys)("dgs.command_line.greet_command")
    file.add_arguments, file.greet_command = add_arguments, greet_command
    monkeypatch.setitem(sys.modules, file.__name__, file)
    commands = (*COMMANDS, Command("greet", "says hello", needs_engine=False))
    monkeypatch.setattr("dgs.command_line.table.COMMANDS", commands)
    monkeypatch.setattr(main, "COMMANDS", commands)
    assert run(["--help"]) == 0 and "says hello" in capsys.readouterr().out
    assert run(["greet", "--times", "2"]) == 0 and capsys.readouterr().out.split() == ["hello", "hello"]
    assert run(["greet", "--often", "2"]) == 2 and "--often" in capsys.readouterr().err
