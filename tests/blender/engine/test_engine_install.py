"""The engine's environment: made from a folder of wheels by the real pip, repeated, cancelled, checked."""

from __future__ import annotations

import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.dgs_addon.engine.errand import Errand, ErrandStep  # noqa: E402
from dgs.dgs_addon.engine.folder import REQUIREMENTS, engine_folder, python_in, stamp  # noqa: E402
from dgs.dgs_addon.engine.install import doctor_step, install_steps  # noqa: E402
from dgs.dgs_addon.engine.interpreter import find_python  # noqa: E402

ROOT = Path(dgs.__path__[0])


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    """A folder with a wheel of a package of one line."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    with zipfile.ZipFile(folder / "tiny-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr("tiny.py", "VALUE = 42\n")
        wheel.writestr("tiny-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n")
        wheel.writestr("tiny-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr("tiny-1.0.dist-info/RECORD", "")
    return folder


def finish(steps: list[ErrandStep]) -> Errand:
    work = Errand(steps)
    work.start()
    assert work.join(120)
    return work


def test_installs_offline_and_may_be_repeated(wheels: Path, tmp_path: Path) -> None:
    wanted = tmp_path / "requirements.txt"
    wanted.write_text("tiny==1.0\n", encoding="utf-8")
    folder = tmp_path / "an engine"
    for _ in range(2):
        work = finish(install_steps(folder, wanted, wheels))
        assert work.status == 0, list(work.lines)
        assert work.done == work.total and stamp(folder, wanted).is_file()
    code = "import tiny, sys; print(tiny.VALUE, sys.prefix != sys.base_prefix)"
    done = subprocess.run([str(python_in(folder)), "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["42", "True"]
    wanted.write_text("tiny==1.0\n# of a newer version of the add-on\n", encoding="utf-8")
    assert not stamp(folder, wanted).is_file()
    # A package that is not among the wheels: it fails, says so, and is not taken for installed.
    wanted.write_text("tiny==2.0\n", encoding="utf-8")
    work = finish(install_steps(folder, wanted, wheels))
    assert work.status == 1 and work.title == "Installing the packages"
    assert "tiny==2.0" in " ".join(work.lines) and not stamp(folder, wanted).is_file()


def test_cancel_ends_the_command_that_runs() -> None:
    work = Errand([ErrandStep("Sleeping", [sys.executable, "-c", "import time; print(1, flush=True); time.sleep(60)"])])
    work.start()
    while not work.lines or work.lines[-1] != "1":
        time.sleep(0.02)
    assert work.running
    work.cancel()
    assert work.join(5) and work.status == -1 and work.cancelled


def test_a_program_that_is_not_there_is_said(tmp_path: Path) -> None:
    work = finish([ErrandStep("Trying", [str(tmp_path / "nothing")])])
    assert work.status == 1 and "Trying" in work.lines[-1]


def test_the_engine_checks_itself() -> None:
    work = finish([doctor_step(find_python())])
    assert work.status == 0, list(work.lines)
    words = " ".join(work.lines)
    assert "torch" in words and "rasterizer  ok" in words


def test_a_script_has_no_folder_of_its_own() -> None:
    assert engine_folder() is None


def test_the_engine_gets_what_the_repository_was_tested_with() -> None:
    def lines(path: Path) -> set[str]:
        return {line.strip() for line in path.read_text("utf-8").splitlines() if line.strip() and line[0] != "#"}

    wanted = {line.split(";")[0] for line in lines(REQUIREMENTS) if "python_version >=" not in line}
    assert wanted == lines(ROOT / "requirements.txt")
