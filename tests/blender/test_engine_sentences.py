"""What the engine says, in the user's language: every error and verdict is recognised, and nothing else."""

from __future__ import annotations

import ast
import json
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.errors import FormatError, PhotoError  # noqa: E402
from dgs.core.measure.boards import parsed_board  # noqa: E402
from dgs.core.photos.load import load_photos  # noqa: E402
from dgs.core.progress import Silent  # noqa: E402
from dgs.core.report.verdict import Verdict, verdict  # noqa: E402
from dgs.dgs_addon import engine_sentences  # noqa: E402
from dgs.dgs_addon.engine_sentences import TABLES, WORDS, Sentence, in_users_language  # noqa: E402
from dgs.dgs_addon.job.state import ending  # noqa: E402
from dgs.dgs_addon.translations import table  # noqa: E402
from dgs.tests.blender.raised import PLACE, raised_in, shown_in, strings_in  # noqa: E402
from dgs.tests.core.report.scored_views import NAMES, ring_of, scored  # noqa: E402

ROOT = Path(dgs.__path__[0])
GERMAN: dict[str, str] = json.loads((TABLES / "de_DE.json").read_text("utf-8"))
#: Commands that only developers call, or whose work no panel asks for.
NOT_ASKED_FOR = ("stress_command.py", "fuzz_files.py", "workers.py")
#: Shares, angles and names in a verdict.
FIGURES = re.compile(r"[\d.]+ %|\d+°|\d\.png")


def files(*places: str) -> list[Path]:
    found = [path for place in places for path in sorted((ROOT / place).rglob("*.py"))]
    return [path for path in found if path.name not in NOT_ASKED_FOR]


@cache
def said() -> dict[str, str]:
    """All sentences of errors that the panel may show, with where they stand."""
    shown = shown_in([*files("dgs_addon", "operators", "core/serving"), ROOT / "core" / "measure" / "listening.py"])
    last_door = shown_in([ROOT / "command_line" / name for name in ("main.py", "refusals.py")])
    return {**raised_in(files("core", "command_line", "dgs_addon", "operators")), **shown, **last_door}


def shape(sentence: str) -> str:
    return re.sub(r"{\w+}", PLACE, sentence)


def holding(text: str) -> Iterator[str]:
    """The sentences with further words of the engine in them that `text` is one of."""
    for english, anew in GERMAN.items():
        if f"{{{WORDS}}}" in english and Sentence.parse(english, anew).places(text) is not None:
            yield english


def verdicts() -> list[Verdict]:
    """Verdicts of all kinds, with all that may help."""
    rising = [{"step": i, "heldout_psnr": 20.0 + i} for i in range(8)]
    ring, wide = ring_of(5.0), ring_of(40.0)
    doubted = replace(ring, figures=replace(ring.figures, doubted=0.16))
    found = [verdict([], [], ring, []), verdict([scored("0.png", 0.03)], [], ring, [])]
    for unseen, fitted in product((0.005, 0.05, 0.12, 0.5), (0.02, 0.4)):
        for cameras in (ring, wide, doubted):
            found.append(verdict([scored("0.png", unseen)], [scored(name, fitted) for name in NAMES[1:]], cameras, []))
    found.append(verdict([scored("0.png", 0.5, matched_gain=2.0)], [scored("1.png", 0.3)], ring, rising))
    alone = replace(wide, poses={name: wide.poses[name] for name in NAMES[:2]})
    return [*found, verdict([scored("0.png", 0.5)], [scored("1.png", 0.01)], alone, [])]


def forget() -> None:
    engine_sentences._anew.cache_clear()
    engine_sentences._one_anew.cache_clear()


@pytest.fixture
def german(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine_sentences, "_locale", lambda: "de_DE")


def test_every_error_that_the_panel_may_show_has_a_translation() -> None:
    known = {shape(sentence) for sentence in GERMAN}
    missing = {place: text for text, place in said().items() if text not in known and not any(holding(text))}
    assert len(said()) > 700
    assert missing == {}, "languages/engine/de_DE.json does not have these"


def test_every_verdict_is_said_in_german(german: None) -> None:
    for found in verdicts():
        for text in (found.sentence, *found.help):
            anew = in_users_language(text)
            assert anew != text and FIGURES.findall(anew) == FIGURES.findall(text)


def test_nothing_is_translated_that_the_engine_does_not_say() -> None:
    one_by_one = engine_sentences.sentences("de_DE")
    texts = [text for found in verdicts() for text in (found.sentence, *found.help)]
    reached = {next(one.anew for one in one_by_one if one.places(text) is not None) for text in texts}
    known = {*said(), *strings_in(files("core", "dgs_addon"))}
    used = {english for text in said() for english in holding(text)}
    gone = [text for text, anew in GERMAN.items() if shape(text) not in known and text not in used]
    assert [text for text in gone if GERMAN[text] not in reached] == []


def test_places_are_the_same_in_both_languages_and_stand_apart() -> None:
    for english, anew in GERMAN.items():
        names = re.findall(r"{(\w+)}", english)
        assert sorted(names) == sorted(re.findall(r"{(\w+)}", anew)), english
        assert len(names) == len(set(names)) and not re.search(r"}{", english), english
        assert anew.endswith(".") == english.endswith("."), english


def test_each_sentence_comes_back_with_what_stood_in_its_places(german: None) -> None:
    for english, anew in GERMAN.items():
        names = re.findall(r"{(\w+)}", english)
        values = {name: f"Wert-{i}.7 µ" for i, name in enumerate(names)}
        text, expected = Sentence.parse("", english).filled(values), Sentence.parse("", anew).filled(values)
        assert in_users_language(text) == expected
        if not text.endswith("."):
            assert in_users_language(f"{text}. Export it again.") == f"{expected}. Exportieren Sie es noch einmal."


def test_of_two_that_fit_the_one_that_says_more_is_taken(german: None, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {"There is no {kind} '{name}'": "allgemein", "There is no folder '{name}'": "genau", "There is {what}": "?"}
    table_of = tuple(sorted((Sentence.parse(*line) for line in lines.items()), key=lambda one: -one.letters))
    monkeypatch.setattr(engine_sentences, "sentences", lambda locale: table_of)
    forget()
    try:
        assert in_users_language("There is no folder 'a'") == "genau"
        assert in_users_language("There is no twin 'a'") == "allgemein"
        assert in_users_language("There is light") == "?"
        assert in_users_language("There is no folder ''") == "?", "no place is empty"
    finally:
        forget()


def test_no_place_takes_words_of_its_sentence() -> None:
    named = Sentence.parse("'{list}' names '{name}', which is not there", "")
    assert named.places("'a b' names 'c' names 'd', which is not there") == {"list": "a b", "name": "c' names 'd"}
    assert named.places("'a' names 'b', which is not here") is None
    assert named.places("'a' names '', which is not there") is None
    once = Sentence.parse("abc{x}abc", "")
    assert once.places("abc") is None and once.places("abcabc") is None and once.places("abc-abc") == {"x": "-"}


@pytest.mark.parametrize(
    ("text", "anew"),
    [
        (
            "There is no path 'x'. Choose one of front, rail.",
            "Weg: 'x' gibt es nicht. Wählen Sie eines aus front, rail.",
        ),
        ("Masks: 'a. b.png' is truncated", "Masken: 'a. b.png' ist abgeschnitten"),
        (
            "2 of 3 failed, the first for this: '/a. b/c' is not a folder. Name the folder that holds the photos.",
            "2 von 3 sind fehlgeschlagen, der erste Satz aus diesem Grund: '/a. b/c' ist kein Ordner. "
            "Nennen Sie den Ordner, in dem die Fotos liegen.",
        ),
        ("Nobody has said this. Export it again.", "Nobody has said this. Exportieren Sie es noch einmal."),
        ("'a.ply' was cut off. Nobody has said this.", "'a.ply' wurde abgeschnitten. Nobody has said this."),
        ("Something {entirely} else. 100 % {0} {", "Something {entirely} else. 100 % {0} {"),
        ("'{words}' was cut off", "'{words}' wurde abgeschnitten"),
        ("", ""),
    ],
)
def test_errors_and_ways_out(text: str, anew: str, german: None) -> None:
    assert in_users_language(text) == anew


def test_errors_as_the_engine_raises_them(german: None, tmp_path: Path) -> None:
    def said_of(kind: type[Exception], does: Callable[[], object]) -> str:
        with pytest.raises(kind) as caught:
            does()
        return in_users_language(str(caught.value))

    assert said_of(PhotoError, lambda: load_photos(tmp_path / "gone", None, Silent())) == (
        f"Es gibt keinen Ordner '{tmp_path / 'gone'}'. Prüfen Sie den Pfad der Fotos."
    )
    assert said_of(FormatError, lambda: parsed_board("charuco:4x4_50,7x5,30mm,22cm")).startswith(
        "'charuco:4x4_50,7x5,30mm,22cm' ist keine Markertafel: ihre Längen sind in mm und in cm. Schreiben Sie aruco:"
    )
    killed = in_users_language(ending(-9, "", cancelled=False)[1])
    assert killed.startswith("Die Engine wurde durch SIGKILL beendet (dem System ging der Arbeitsspeicher aus")
    assert killed.endswith("Drücken Sie Fortsetzen, um dort weiterzumachen.")


def test_an_operator_says_it(german: None, tmp_path: Path) -> None:
    dgs.register()
    try:
        with pytest.raises(
            RuntimeError, match=r"Es gibt keine Datei '.*gone\.ply'\. Geben Sie den Pfad einer 3DGS-PLY an\."
        ):
            bpy.ops.dgs.import_twin(filepath=str(tmp_path / "gone.ply"))
    finally:
        dgs.unregister()


def test_in_english_all_stays_as_it_is_and_no_table_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(locale: str) -> None:
        raise AssertionError("a table was asked for")

    monkeypatch.setattr(engine_sentences, "sentences", forbidden)
    for found in verdicts():
        for text in (found.sentence, *found.help, "'a' was cut off. Export it again.", ""):
            assert in_users_language(text) == text


@pytest.mark.parametrize(("locale", "translated"), [("en_US", True), ("fr_FR", True), ("de_DE", False), ("", True)])
def test_no_table_no_translation(locale: str, translated: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    view = SimpleNamespace(use_translate_interface=translated)
    blender = SimpleNamespace(
        app=SimpleNamespace(translations=SimpleNamespace(locale=locale)),
        context=SimpleNamespace(preferences=SimpleNamespace(view=view)),
    )
    monkeypatch.setattr(engine_sentences, "bpy", blender)
    assert in_users_language("'a' was cut off") == "'a' was cut off"


def test_blenders_language_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    view = SimpleNamespace(use_translate_interface=True)
    blender = SimpleNamespace(
        app=SimpleNamespace(translations=SimpleNamespace(locale="de_DE")),
        context=SimpleNamespace(preferences=SimpleNamespace(view=view)),
    )
    monkeypatch.setattr(engine_sentences, "bpy", blender)
    assert in_users_language("'a' was cut off") == "'a' wurde abgeschnitten"


def test_the_panels_own_texts_and_the_engines_have_tables_of_their_own() -> None:
    common = GERMAN.keys() & table("de_DE").keys()
    assert all(GERMAN[text] == table("de_DE")[text] for text in common)


def test_a_long_error_takes_no_time(german: None) -> None:
    began = time.process_time()
    in_users_language("'a' is damaged (" + "x. " * 2000 + "). Export it again.")
    assert time.process_time() - began < 1.0


def test_all_errors_that_are_shown_go_through_the_translation() -> None:
    for path in files("operators", "panels"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in (
                "report",
                "sentence",
            ):
                for argument in node.args:
                    words = ast.unparse(argument)
                    assert not re.fullmatch(r"str\(error\)|[\w.]+\.(error|trouble|reason|why)", words), (path, words)
