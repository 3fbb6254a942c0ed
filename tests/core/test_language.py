"""The words of docs/glossary.md: those that it bans do not come back, and what the docs point at is there."""

import re
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from dgs.tests.core.import_graph import FLOORS

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = ROOT / "docs" / "glossary.md"
#: The table itself, what was said in the past, and this file.
EXEMPT = {"docs/glossary.md", "CHANGELOG.md", "tests/core/test_language.py"}
#: Uses of a banned word that are left, by word; these may only shrink. Rows that earlier versions kept say "told".
LEFT: dict[str, int] = {"told": 2}
#: Where a folder of the code is meant; 'core' alone is no path.
CODE = re.compile(r"`((?:core|studies|command_line|dgs_addon|operators|panels|tests|tools|benchmarks|docs)/[\w./*-]*)`")
#: Made by commands, or a pattern of names.
NOT_KEPT = ("benchmarks/data", "benchmarks/runs", "dgs_addon/languages/LOCALE.json")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


@cache
def tracked() -> tuple[Path, ...]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("no git clone")
    return tuple(ROOT / name for name in listing.stdout.decode().split("\0") if name and (ROOT / name).is_file())


@cache
def banned() -> tuple[str, ...]:
    """The words in backticks of the first column of the glossary's last table."""
    table = GLOSSARY.read_text("utf-8").split("## Words that we do not use")[1]
    rows = [line for line in table.splitlines() if line.startswith("| `")]
    return tuple(word for row in rows for word in re.findall(r"`([^`]+)`", row.split("|")[1]))


def pattern(word: str) -> str:
    """Capitals are matched as a whole name, other words as a part of one, too (`told_error`, but not `untold`)."""
    return rf"(?<!\w){re.escape(word)}(?!\w)" if word.isupper() else rf"(?<![A-Za-z]){re.escape(word)}(?![a-z])"


@cache
def uses() -> dict[str, Counter[str]]:
    """By banned word, how often it stands in which file."""
    searched = {word: re.compile(pattern(word)) for word in banned()}
    found: dict[str, Counter[str]] = {word: Counter() for word in searched}
    for path in tracked():
        name = path.relative_to(ROOT).as_posix()
        if path.suffix not in (".py", ".md") or name in EXEMPT:
            continue
        text = path.read_text("utf-8")
        for word, expression in searched.items():
            count = len(expression.findall(text))
            if count:
                found[word][name] = count
    return found


def test_the_glossary_bans_words():
    assert "told" in banned() and "FEWEST" in banned() and len(banned()) > 15
    assert re.search(pattern("told"), "the told_error") and not re.search(pattern("told"), "untold")
    assert re.search(pattern("MOST"), "x = MOST,") and not re.search(pattern("MOST"), "MOST_STATIONS")
    assert set(LEFT) <= set(banned())


@pytest.mark.parametrize("word", banned())
def test_a_banned_word_does_not_come_back(word):
    found = uses()[word]
    limit = LEFT.get(word, 0)
    assert sum(found.values()) <= limit, (
        f"'{word}' stands in {found.most_common(9)}; docs/glossary.md says what to write"
    )


def documents() -> list[Path]:
    return [path for path in tracked() if path.suffix == ".md"]


def test_links_lead_somewhere():
    broken = []
    for path in documents():
        for target in LINK.findall(path.read_text("utf-8")):
            name = target.split("#")[0]
            if name and "://" not in name and not name.startswith("mailto:") and not (path.parent / name).exists():
                broken.append(f"{path.relative_to(ROOT)}: {target}")
    assert not broken


def test_files_that_the_docs_name_are_there():
    missing = []
    for path in documents():
        if path.name == "CHANGELOG.md":
            continue
        for name in CODE.findall(path.read_text("utf-8")):
            if not any(ROOT.glob(name.rstrip("/"))) and not name.startswith(NOT_KEPT):
                missing.append(f"{path.relative_to(ROOT)}: {name}")
    assert not missing


def test_the_architecture_names_every_package():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    packages = {name for floor in FLOORS for name in floor}
    assert sorted(name for name in packages if name.split(".")[-1] + "/" not in page) == []
