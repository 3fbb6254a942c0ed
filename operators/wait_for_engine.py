"""What the operators that ask the engine a question have in common."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy

from ..dgs_addon.engine.question import Question
from ..dgs_addon.engine_sentences import in_users_language


def answered(operator: Any, question: Question, then: Callable[[], None]) -> set[str]:
    """Calls `then` once the engine has answered; without a window it is waited for, and an error is the operator's."""
    if not bpy.app.background:

        def check() -> float | None:
            if not question.take():
                return 0.2 if question.running else None
            then()
            return None

        bpy.app.timers.register(check, first_interval=0.2, persistent=True)  # another file may be opened meanwhile
        return {"FINISHED"}
    while not question.take():
        time.sleep(0.05)
    then()
    if question.error:
        operator.report({"ERROR"}, in_users_language(question.error))
        return {"CANCELLED"}
    return {"FINISHED"}
