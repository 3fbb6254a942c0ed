"""`run_dgs.py stress`: a line per case, a status, a document; and a case that fails is seen to fail."""

import json

from dgs.command_line import run
from dgs.studies.stability import case as case_module
from dgs.studies.stability import registry, table
from dgs.studies.stability.case import Case, measured, runs
from dgs.studies.stability.registry import all_cases


def test_the_table_as_lines_json_and_document(tmp_path, capsys):
    document = tmp_path / "stability.md"
    document.write_text(f"before\n{table.BEGIN}\nprevious\n{table.END}\nafter\n", "utf-8")
    assert run(["stress", "--only", "half a circle", "--only", "SSIM of flat", "--markdown", str(document)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(" pass " in line for line in lines) == 2 and lines[-1].startswith("2 of 2 hold, 0 failed")
    text = document.read_text("utf-8")
    assert (
        text.startswith("before\n")
        and text.endswith("after\n")
        and "previous" not in text
        and "SSIM of flat images" in text
    )
    assert run(["stress", "--only", "half a circle", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["failed"] == 0 and content["cases"][0]["passed"] and content["machine"]["cores"] >= 1


def test_failures_are_seen(monkeypatch, capsys):
    def broken(place):
        raise RuntimeError("no\nway")

    kinds = {"nan": lambda place: float("nan"), "big": lambda place: 2.0, "raised": broken}
    bad = [Case(name, "scale", "", "holds", 1.0, "", measure) for name, measure in kinds.items()]
    monkeypatch.setattr(registry, "CASES", bad)
    assert run(["stress", "--only", "scale"]) == 2
    said = capsys.readouterr().out
    assert said.count("FAIL") == 3 and "RuntimeError: no way" in said


def test_every_family_has_cases_and_names_are_unique():
    cases = all_cases()
    assert {c.family for c in cases} == set(case_module.FAMILIES)
    assert len({c.name for c in cases}) == len(cases) > 60
    assert all(c.states and c.invariant and c.reason and c.tolerance >= 0 for c in cases)
    assert {b for _, b in runs(cases, case_module.backends_for("cpu"))} == {"", "reference", "cpu"}


def test_a_result_that_is_nan_fails():
    one = Case("x", "scale", "", "", 1.0, "", lambda place: float("nan"))
    assert not measured(one, "").passed
