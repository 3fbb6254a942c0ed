"""How the process of a command ends: at once where kernels were compiled, with all that was said and asked for."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ENDS = """
import atexit, sys, types
import run_dgs

class Held:
    def __del__(self):
        print("taken apart")

held = Held()
for name in sys.argv[2:]:
    sys.modules[name] = types.ModuleType(name)
atexit.register(print, "asked for")
print("said", end=" ")
run_dgs.end(int(sys.argv[1]))
"""


@pytest.mark.parametrize(
    ("status", "loaded", "said"),
    [
        (0, ["llvmlite"], "said asked for\n"),
        (2, ["llvmlite"], "said asked for\n"),
        (130, ["llvmlite"], "said "),
        (0, [], "said asked for\ntaken apart\n"),
        (3, ["llvmlite", "bpy"], "said asked for\ntaken apart\n"),
    ],
)
def test_what_a_process_does_at_its_end(status, loaded, said):
    command = [sys.executable, "-c", ENDS, str(status), *loaded]
    found = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert found.returncode == status, found.stderr
    assert found.stdout == said
