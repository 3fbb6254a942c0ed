"""A question to the engine: the answer among its words, or what went wrong."""

from __future__ import annotations

import sys

import pytest

pytest.importorskip("bpy")

from dgs.dgs_addon.engine.question import Question, read_answer


@pytest.mark.parametrize(
    ("lines", "status", "expected"),
    [
        (['$ run {"sigma": 9}', "a warning", '{"sigma": 3.0}', "a word after it"], 0, ({"sigma": 3.0}, "")),
        (["$ run", '{"effects": 1}', "{", ' "sigma": 3.0', "}"], 0, ({"sigma": 3.0}, "")),
        (["$ run", "{half", "Nothing stands out"], 0, ({}, "Nothing stands out")),
        (["$ run", '{"sigma": 3.0}', "It failed at the end"], 2, ({}, "It failed at the end")),
        (["$ run", ""], 1, ({}, "The engine ended with status 1")),
    ],
)
def test_the_answer_is_the_object_with_its_key(lines: list[str], status: int, expected: tuple[object, str]) -> None:
    assert read_answer(lines, status, "sigma") == expected


def test_a_question_is_asked_and_answered_beside_blender() -> None:
    question = Question("sigma")
    assert not question.running and not question.take()
    question.ask(("photo",), "Measuring", [sys.executable, "-c", "print('{\"sigma\": 2}')"])
    errand = question.errand
    assert errand is not None and errand.join(30.0)
    assert question.take() and question.answer == {"sigma": 2} and question.error == ""
    assert question.subject == ("photo",) and not question.take()


def test_a_question_that_is_stopped_has_no_answer() -> None:
    question = Question("sigma")
    question.ask((), "Measuring", [sys.executable, "-c", "import time; time.sleep(60)"])
    question.stop()
    assert not question.running and question.take() and question.answer == {}
