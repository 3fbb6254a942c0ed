#!/usr/bin/env python3
"""Descattering Gaussian splatting from the command line.

python run_dgs.py reconstruct PHOTOS --out DIR --psf gaussian:5
blender -b -P run_dgs.py -- reconstruct PHOTOS --out DIR --psf gaussian:5
"""

from __future__ import annotations

import atexit
import contextlib
import importlib.util
import json
import os
import sys
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parent
PACKAGE = "dgs"
#: Exit status of a command that the user stopped: what is finished is saved.
STOPPED = 130
#: Variable of the environment that is set where the add-on starts this file.
BY_BLENDER = "DGS_STARTED_BY_BLENDER"


def mount_package() -> None:
    """Makes this folder importable as the package `dgs`, whatever the clone is called.

    All code imports relatively, so that the same files also work as a Blender extension
    (`bl_ext.user_default...`).
    """
    if PACKAGE in sys.modules:
        return
    spec = importlib.util.spec_from_file_location(PACKAGE, ROOT / "__init__.py", submodule_search_locations=[str(ROOT)])
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[PACKAGE] = module
    spec.loader.exec_module(module)


def lacks_packages(arguments: list[str]) -> bool:
    """Whether this Python lacks what the command needs, as Blender's own Python lacks the engine's packages."""
    from dgs.command_line.table import command_of  # late: the package has to be mounted first

    command = command_of(arguments)
    return command is not None and command.needs_engine and importlib.util.find_spec("torch") is None


def main() -> int:
    """Runs the command line and returns its exit status."""
    # A spinning OpenMP thread starves whoever shares the machine (measured: 200 -> 2400 ms).
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    # scipy's linear algebra here is a thousand 2 x 2 systems: threads only wait for each other (1 -> 30 s).
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    mount_package()
    arguments = sys.argv[1:]
    if "--" in arguments:  # behind `blender -b -P run_dgs.py --`
        arguments = arguments[arguments.index("--") + 1 :]
    if lacks_packages(arguments):
        if importlib.util.find_spec("bpy") is None:
            return refuse_this_python(arguments)
        from dgs.dgs_addon.engine.handover import hand_over  # late: only in Blender

        return hand_over(arguments)
    from dgs.command_line import run  # late: the package has to be mounted first

    return run(arguments)


def refuse_this_python(arguments: list[str]) -> int:
    """Says which Python to use, to whoever chose this one, and where they look; the exit status."""
    if BY_BLENDER not in os.environ:
        print("This Python lacks the engine's packages: run 'make setup', then use .venv/bin/python", file=sys.stderr)
        return 2
    words = (
        f"The Python '{sys.executable}' lacks the engine's packages. Choose another one in the add-on's preferences, "
        "or leave that field empty and press Install Engine."
    )
    if ("--progress", "json") in zip(arguments, arguments[1:]):  # noqa: B905 (any Python must read this file)
        print(json.dumps({"event": "error", "text": words, "status": 2}), flush=True)
    else:
        print(words, file=sys.stderr)
    return 2


def end(status: int) -> NoReturn:
    """Ends this process; one that has compiled kernels at once: to take their compiler's memory apart takes 2 s.

    8 s where the user stopped it, who waits for nothing else then. Blender ends by itself.
    """
    if status != STOPPED:
        if "llvmlite" not in sys.modules or "bpy" in sys.modules:
            sys.exit(status)
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # nobody reads it any more
            stream.flush()
    os._exit(status)


def command() -> NoReturn:
    """The command `dgs` of the installed package."""
    end(main())


if __name__ == "__main__":
    command()
