"""tools/test.py: every file is run, once; a process of tests that hangs is ended, heard and begun anew once."""

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import dgs
import pytest

HANGS = """
import threading
def test_that_hangs():
    stuck = threading.Lock()
    stuck.acquire()
    stuck.acquire()
"""


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    described = importlib.util.spec_from_file_location("dgs_tools_test", Path(dgs.__path__[0]) / "tools/test.py")
    assert described is not None and described.loader is not None
    module = importlib.util.module_from_spec(described)
    monkeypatch.setitem(sys.modules, "dgs_tools_test", module)
    described.loader.exec_module(module)
    return module


def test_every_file_is_run_once(runner: ModuleType) -> None:
    """pytest goes into the folders of a folder, which are targets of their own."""
    run = []
    for target in runner.targets():
        at = runner.ROOT / target
        run += runner.ROOT.glob(target) if "*" in target else at.rglob("test_*.py") if at.is_dir() else [at]
    assert sorted(run) == sorted((runner.ROOT / "tests").rglob("test_*.py"))


def test_what_hangs_fails_and_says_where(runner: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "test_hanging.py").write_text(HANGS)
    ran = runner.attempt(str(tmp_path / "test_hanging.py"), [], limit=12.0)
    assert ran.hung and not ran.fine and ran.failed == 1
    assert "in test_that_hangs" in ran.output


@pytest.mark.parametrize(("first", "attempts"), [(True, 2), (False, 1)])
def test_only_what_hung_is_begun_anew(
    runner: ModuleType, monkeypatch: pytest.MonkeyPatch, first: bool, attempts: int
) -> None:
    one = runner.Ran("x", 1, 1, 0, 1, 0.0, "")
    left = [replace(one, hung=first), one, one]
    monkeypatch.setattr(runner, "attempt", lambda *_: left.pop(0))
    assert len(runner.run("x", [])) == attempts, "a failure is no hang"


def test_a_process_that_will_not_speak_is_killed(runner: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "LAST_WORDS", 0.5)
    deaf = "import signal, time; signal.signal(signal.SIGABRT, signal.SIG_IGN); print(flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", deaf], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert not runner.ends(process, 0.1)
    assert process.returncode == -9
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        assert runner.ends(process, 30.0)
