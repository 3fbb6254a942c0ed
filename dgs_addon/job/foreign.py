"""Whether a job's folder holds what this add-on did not write, found out before anything is written there."""

from __future__ import annotations

from pathlib import Path

from ...core.errors import ForeignFiles
from ...core.outputs import check_output_folder
from ...core.run_settings import RUN_MARKS, RUN_REPLACES
from .request import Kind

#: What a test set leaves, as `synthesize` names it.
_SET_MARKS = ("manifest.json", "unfinished.json")


def foreign_files(kind: Kind, out: Path) -> str:
    """What a job would replace that is not this add-on's, in one sentence; '' if it replaces nothing of others.

    The engine asks the same. But by then the job's own record lies in the folder, which marks it as this program's.
    """
    try:
        if kind in ("cameras", "reconstruct"):
            check_output_folder(out, RUN_MARKS, replaced=RUN_REPLACES)
        elif kind == "synthesize":
            check_output_folder(out, _SET_MARKS)
    except ForeignFiles as error:
        return error.what
    except OSError:  # it cannot be listed, and so not written to; whoever writes says why
        return ""
    return ""
