"""What libraries print through C is kept off the terminal, and named where a command fails."""

import subprocess
import sys
from pathlib import Path

import dgs
import pytest

ROOT = Path(dgs.__file__).parent

#: A command with a noisy library inside, in the place of one that has Blender inside.
PROGRAM = """
import ctypes, os, sys
sys.path.insert(0, sys.argv[1])
import run_dgs; run_dgs.mount_package()
from dgs.command_line import main, table
from dgs.core.errors import FormatError

def noisy_command(options, progress):
    ctypes.CDLL(None).printf(b"noise of C\\n")  # stays in C's buffer
    os.write(2, b"noise of a library\\n")
    progress.stage("work", 2)
    print("a result", flush=True)
    if "fail" in options.how:
        raise FormatError("It did not work", "Do it better")
    if "stop" in options.how:
        raise KeyboardInterrupt
    if "crash" in options.how:
        ctypes.string_at(0)
    return 0

file = type(sys)("dgs.command_line.noisy_command")
file.noisy_command, file.add_arguments = noisy_command, lambda parser: parser.add_argument("how")
sys.modules[file.__name__] = file
main.COMMANDS = table.COMMANDS = (table.Command("noisy", "makes noise", needs_engine=False),)
status = main.run(["noisy", sys.argv[2]])
print("after", flush=True)
sys.exit(status)
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the noise is made with the C library of POSIX")


def execute(how, folder):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, str(ROOT), how],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": "/usr/bin:/bin", "TMPDIR": str(folder)},
    )


def logs(folder):
    return list(folder.glob("dgs-noisy-*.log"))


def test_noise_is_kept_off_the_terminal(tmp_path):
    done = execute("well", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "a result\nafter\n" and done.stderr == "" and logs(tmp_path) == []


def test_a_failure_names_what_the_libraries_said(tmp_path):
    done = execute("fail", tmp_path)
    (log,) = logs(tmp_path)
    assert done.returncode == 2 and "noise" not in done.stderr
    assert done.stderr.splitlines()[0] == "It did not work. Do it better." and str(log) in done.stderr.splitlines()[1]
    assert sorted(log.read_text().splitlines()) == ["noise of C", "noise of a library"]


def test_a_stop_names_nothing(tmp_path):
    done = execute("stop", tmp_path)
    assert done.returncode == 130 and done.stderr.count("\n") == 1 and logs(tmp_path) == []


def test_a_crash_is_seen_and_keeps_the_log(tmp_path):
    done = execute("crash", tmp_path)
    assert done.returncode < 0 and "Segmentation fault" in done.stderr and "noisy_command" in done.stderr
    assert "noise of a library" in logs(tmp_path)[0].read_text()
