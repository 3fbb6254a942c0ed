"""Two commands never write into one twin's folder, and what a kill left is put right by the next one."""

from __future__ import annotations

import os

import pytest
from dgs.command_line import run
from dgs.core.lock import locked
from dgs.core.transaction import COMMIT, CONTENT, LIST, NEXT


@pytest.mark.parametrize(
    "command",
    [
        ["reconstruct", "PHOTOS", "--out", "TWIN"],
        ["cameras", "PHOTOS", "--out", "TWIN"],
        ["update", "TWIN", "PHOTOS"],
        ["update", "TWIN", "--rollback"],
        ["next-view", "TWIN"],
    ],
    ids=lambda command: "_".join(word for word in command if word.islower()),
)
def test_a_second_command_is_refused_and_names_the_first(command, tmp_path, capfd):
    (tmp_path / "twin").mkdir()
    (tmp_path / "photos").mkdir()
    words = [str(tmp_path / word.lower()) if word.isupper() else word for word in command]
    with locked(tmp_path / "twin", "another run"):
        assert run([*words, "--progress", "none"]) == 2
    error = capfd.readouterr().err
    assert "Another process works on" in error and f"process {os.getpid()}, another run" in error


def test_an_unfinished_change_is_completed_by_the_next_command(tmp_path, capfd):
    twin = tmp_path / "twin"
    (twin / COMMIT / CONTENT).mkdir(parents=True)
    (twin / COMMIT / CONTENT / "update.json").write_text("{}")
    (twin / COMMIT / LIST).write_text('{"format": 1, "place": ["update.json"], "remove": []}')
    assert run(["update", str(twin), "--rollback", "--progress", "none"]) == 2  # there is no earlier state
    assert (twin / "update.json").read_text() == "{}"
    (twin / NEXT / CONTENT).mkdir(parents=True)
    (twin / NEXT / CONTENT / "update.json").write_text("half")
    assert run(["update", str(twin), "--rollback", "--progress", "none"]) == 2
    assert (twin / "update.json").read_text() == "{}" and not (twin / NEXT).exists()


@pytest.mark.parametrize("command", [["update", "NOWHERE", "--rollback"], ["next-view", "NOWHERE"]])
def test_a_folder_that_is_not_there_is_not_made(command, tmp_path, capfd):
    words = [str(tmp_path / "nowhere") if word.isupper() else word for word in command]
    assert run([*words, "--progress", "none"]) == 2
    assert "There is no folder" in capfd.readouterr().err and not (tmp_path / "nowhere").exists()
