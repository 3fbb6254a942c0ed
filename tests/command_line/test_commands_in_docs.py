"""Commands, options, targets and measurements that the docs name are there."""

import argparse
import re
from functools import cache
from pathlib import Path

import dgs
import pytest
from dgs.command_line.main import build_parser
from dgs.command_line.table import COMMANDS

ROOT = Path(dgs.__file__).parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: A command up to the end of its line or of its quotes.
CALL = re.compile(r"run_dgs\.py ([a-z][a-z-]+)([^`\n]*)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


@cache
def options_of(command: str) -> set[str]:
    parser = build_parser([command])
    action = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return set(action.choices[command]._option_string_actions)


def names() -> set[str]:
    return {command.name for command in COMMANDS}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_their_options_exist(page):
    wrong = []
    for command, rest in CALL.findall(page.read_text("utf-8")):
        if command not in names():
            wrong.append(command)
        else:
            wrong += [f"{command} {option}" for option in OPTION.findall(rest) if option not in options_of(command)]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_options_that_stand_alone_belong_to_some_command(page):
    known = set().union(*(options_of(name) for name in names()))
    text = page.read_text("utf-8")
    alone = {option for quoted in re.findall(r"`(--[^`]+)`", text) for option in OPTION.findall(quoted)}
    assert sorted(alone - known - _of_other_programs()) == []


def _of_other_programs() -> set[str]:
    """Options of the measurements and tools, read from their source."""
    files = [file for top in ("benchmarks", "studies", "tools") for file in (ROOT / top).rglob("*.py")]
    return {option for file in files for option in re.findall(r'"(--[a-z-]+)"', file.read_text("utf-8"))}


def test_measurements_and_targets_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.M))
    wrong = []
    for page in PAGES:
        text = page.read_text("utf-8")
        for kind, name in re.findall(r"python -m (benchmarks|tools)\.([a-z_]+)", text):
            wrong += [] if (ROOT / kind / f"{name}.py").is_file() else [f"{page.name}: {kind}.{name}"]
        for target in re.findall(r"(?:^    |`)make ([a-z][a-z-]*)", text, re.M):
            wrong += [] if target in targets else [f"{page.name}: make {target}"]
    assert wrong == []
