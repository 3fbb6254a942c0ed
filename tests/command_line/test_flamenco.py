"""Job types for Blender's render farm, compiled as its manager does by a real JavaScript engine; tasks then run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import dgs
import pytest
import quickjs

ROOT = Path(dgs.__file__).parent
#: What Flamenco's manager offers to scripts, as its documentation and its own scripts use it.
_MANAGER = """
const author = {
    Task: (name, type) => ({name, type, commands: [], after: [],
        addCommand(one) { this.commands.push(one); }, addDependency(task) { this.after.push(task.name); }}),
    Command: (name, parameters) => ({name, parameters}),
};
const path = {join: (...parts) => parts.join("/")};
function frameChunker(frames, size) {
    const [first, last] = frames.split("-").map(Number), chunks = [];
    for (let a = first; a <= last; a += size) {
        const b = Math.min(a + size - 1, last);
        chunks.push(a === b ? `${a}` : `${a}-${b}`);
    }
    return chunks;
}
"""


def compiled(script: str, settings: dict[str, Any]) -> list[dict[str, Any]]:
    """The tasks of a job with these settings."""
    context = quickjs.Context()
    context.eval(_MANAGER + (ROOT / "tools" / "flamenco" / script).read_text("utf-8"))
    context.eval("const tasks = [];")
    job = f"{{settings: {json.dumps(settings)}, addTask(task) {{ tasks.push(task); }}}}"
    context.eval(f"compileJob({job})")
    found: list[dict[str, Any]] = json.loads(context.eval("JSON.stringify(tasks)"))
    return found


def test_tasks_of_a_test_set_make_the_set_that_one_command_makes(tmp_path: Path) -> None:
    words = "--size 64x48 --samples 1 --psf gaussian:1 --overscan 4"
    settings = {"program": str(ROOT / "run_dgs.py"), "out": str(tmp_path / "farm"), "views": 4, "words": words}
    tasks = compiled("dgs_laboratory.js", {**settings, "chunk_size": 3})
    assert [task["name"] for task in tasks] == ["photos-0-2", "photos-3", "finish"]
    assert tasks[-1]["after"] == ["photos-0-2", "photos-3"]
    for task in tasks:
        parameters = task["commands"][0]["parameters"]
        assert task["commands"][0]["name"] == "exec" and parameters["exe"] == "{blender}"
        # bpy in this Python stands in for Blender, and takes what stands behind '--' as Blender hands it on.
        program, words_of_task = parameters["args"][4], parameters["args"][5:]
        subprocess.run([sys.executable, program, *words_of_task], check=True, capture_output=True)
        there = sorted(file.name for file in (tmp_path / "farm" / "photos").iterdir())
        assert len(there) == (3 if task["name"] == "photos-0-2" else 4)
        assert (tmp_path / "farm" / "manifest.json").is_file() == (task["name"] == "finish")
    alone = ["synthesize", "--out", str(tmp_path / "alone"), "--views", "4", *words.split()]
    subprocess.run([sys.executable, str(ROOT / "run_dgs.py"), *alone], check=True, capture_output=True)
    for file in sorted((tmp_path / "alone" / "photos").iterdir()):
        assert file.read_bytes() == (tmp_path / "farm" / "photos" / file.name).read_bytes()


def test_what_the_job_says_itself_may_not_be_said_twice() -> None:
    settings = {"program": "p", "out": "o", "views": 4, "words": "--views 9", "chunk_size": 3}
    with pytest.raises(quickjs.JSException, match="settings of their own"):
        compiled("dgs_laboratory.js", settings)


def test_frames_of_a_turntable_come_before_its_film() -> None:
    settings = {"frames": "1-25", "out": "/shared", "chunk_size": 10, "film": True, "blendfile": "a.blend", "fps": 24}
    tasks = compiled("dgs_turntable.js", settings)
    assert [task["name"] for task in tasks] == ["frames-1-10", "frames-11-20", "frames-21-25", "film"]
    assert tasks[-1]["after"] == [task["name"] for task in tasks[:-1]]
    render = tasks[0]["commands"][0]["parameters"]
    assert render["blendfile"] == "a.blend" and render["args"][-2:] == ["--render-frame", "1..10"]
    assert len(compiled("dgs_turntable.js", {**settings, "film": False})) == 3
