"""The report's chapter on what photos determine and what is guessed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from dgs.core.report.known import (
    BEFORE,
    COLOURS,
    END,
    GUESSED,
    START,
    PredictedView,
    add_chapter,
    drop_chapter,
    hatched,
    painted,
)

PAGE = f"<h1>Report</h1>\n{BEFORE}\n<p>cameras</p>\n"


def view(name: str) -> PredictedView:
    error = np.zeros((30, 40), np.float32)
    error[:, 20:] = 1.2
    observed = np.ones((30, 40), np.float32)
    observed[:15, :10] = 0.1
    return PredictedView(name, 1, np.full((30, 40, 3), 128, np.uint8), error, observed)


def test_the_chapter_goes_in_once_and_is_replaced(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text(PAGE)
    assert add_chapter(report, [view("a <b>")], "Measured on 3 photos.")
    first = report.read_text()
    assert first.count("<img") == 3 and "a &lt;b&gt;" in first and "62 % guessed" in first
    assert first.index(START) < first.index(END) < first.index(BEFORE)
    assert add_chapter(report, [view("c"), view("d")], "")
    again = report.read_text()
    assert again.count(START) == 1 and again.count("<img") == 6 and "a &lt;b&gt;" not in again
    assert again.endswith(PAGE.split(BEFORE)[1])
    drop_chapter(report)
    assert report.read_text() == PAGE
    drop_chapter(tmp_path / "none.html")


def test_no_report_or_a_strange_one_is_left_alone(tmp_path: Path) -> None:
    assert not add_chapter(tmp_path / "report.html", [view("a")], "")
    (tmp_path / "report.html").write_text("something else")
    assert not add_chapter(tmp_path / "report.html", [view("a")], "")
    assert (tmp_path / "report.html").read_text() == "something else"


def test_guessed_px_are_hatched_and_red_and_known_ones_stay() -> None:
    one = view("a")
    marked, colours = hatched(one), painted(one.error)
    assert np.array_equal(marked[15:, :20], one.image[15:, :20])
    for lines in (marked[:, 20:].astype(int), marked[:15, :10].astype(int)):
        assert len(np.unique(lines.reshape(-1, 3), axis=0)) == 2 and (lines[..., 0] > lines[..., 1]).any()
    assert (colours[:, :20] == COLOURS[0]).all() and (colours[:, 20:] == COLOURS[2]).all()
    assert GUESSED.error < 1.2
