"""The child process in which pycolmap runs: `python worker.py JOB_FOLDER [--wait]`.

Native code that aborts takes this process down and no other. It says how it fares on stdout, one
JSON object a line: {"stage": ...}, {"note": ...}, {"attempt": {...}}, {"done": {...}} or
{"failed": {"kind": ..., "what": ..., "way_out": ...}}. It ends when its stdin does, which is when
its parent ends.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def say(**message: Any) -> None:
    """One line to the parent."""
    sys.__stdout__.write(json.dumps(message) + "\n")  # type: ignore[union-attr]
    sys.__stdout__.flush()  # type: ignore[union-attr]


def end_with_parent() -> None:
    """Ends this process as soon as the parent's end of stdin is closed."""
    if sys.platform == "linux":  # also when the GIL is held by native code
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)

    def watch() -> None:
        while os.read(0, 4096):
            pass
        os._exit(3)

    threading.Thread(target=watch, daemon=True).start()


def main(folder: Path, waiting: bool = False) -> int:
    """Tries recipe after recipe; the best trusted model goes to `folder`/best (COLMAP binary)."""
    # late: the package is mounted where this file starts
    from dgs.core.imports import large_imports

    with large_imports():
        # late, too
        from dgs.core import compiled
        from dgs.core.sfm import attempts, described, known_poses, placing
        from dgs.core.sfm.child import GO, wait_for
        from dgs.core.sfm.job import KNOWN, ONLY_FEATURES, REFERENCES, read_job
        from dgs.core.sfm.refine import compile_early

    if waiting:
        wait_for(folder / GO)
    job = read_job(folder)
    compiled.set_threads(job.settings.threads)
    started = time.perf_counter()
    if (folder / REFERENCES).is_file():
        outcome = placing.run(job, say)
    elif (folder / KNOWN).is_file():
        outcome = known_poses.run(job, say)
    elif (folder / ONLY_FEATURES).is_file():
        outcome = described.run(job, say)
    else:
        # Native code extracts features without the GIL meanwhile. No daemon: a process that ends amid a
        # compilation may crash.
        threading.Thread(target=compile_early, args=(job.settings.refine,)).start()
        outcome = attempts.run(job, say)
    say(**{outcome.kind: outcome.message, "seconds": time.perf_counter() - started})
    return 0


if __name__ == "__main__":
    end_with_parent()
    sys.path[0] = str(ROOT)  # instead of this folder, whose modules are no top-level ones
    import run_dgs

    run_dgs.mount_package()
    sys.exit(main(Path(sys.argv[1]), "--wait" in sys.argv[2:]))
