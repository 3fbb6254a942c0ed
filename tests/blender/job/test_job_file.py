"""job.json from anybody: data, never a command; and folders that hold files of others."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.errors import FormatError  # noqa: E402
from dgs.dgs_addon.job import runner  # noqa: E402
from dgs.dgs_addon.job.foreign import foreign_files  # noqa: E402
from dgs.dgs_addon.job.options import OPTIONS, check_options, job_arguments, options_of  # noqa: E402
from dgs.dgs_addon.job.record import NAME, Record, read_record  # noqa: E402
from dgs.dgs_addon.job.request import request_of, resumed_request  # noqa: E402
from dgs.dgs_addon.paths import out_folder  # noqa: E402
from dgs.tests.command_line.scene import SIGMA, write_scene  # noqa: E402


@pytest.fixture(scope="module")
def photo_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    write_scene(folder)
    return folder


@pytest.fixture
def settings(photo_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("DGS_ENGINE_PYTHON", sys.executable)
    dgs.register()
    settings = bpy.context.scene.dgs
    settings.photos, settings.out = str(photo_set / "photos"), str(tmp_path / "out")
    settings.cameras, settings.model = "model", str(photo_set / "model")
    settings.medium, settings.sigma, settings.threads = "gaussian", SIGMA, 1
    settings.preset, settings.max_gaussians, settings.holdout_every = "draft", 1000, 4
    settings.effects = "usual"  # trials take longer than these runs
    (tmp_path / "out").mkdir()
    yield settings
    dgs.unregister()


def job(photo_set: Path, **changes: Any) -> dict[str, Any]:
    """The content of a good job.json, changed."""
    options = {"psf": "gaussian:2", "blur_space": "srgb", "preset": "draft", "max_gaussians": 1000, "threads": 1}
    options["cameras"] = str(photo_set / "model")
    good = {"kind": "reconstruct", "photos": str(photo_set / "photos"), "count": 5, "options": options}
    return {**good, "phase": "failed", "pid": None, "error": "", "result": {}, "selection": "", **changes}


def old_job(photo_set: Path, arguments: list[str], **changes: Any) -> dict[str, Any]:
    """As the version before wrote it."""
    content = job(photo_set, arguments=arguments, **changes)
    del content["options"]
    return content


def write(out: Path, content: Any) -> None:
    (out / NAME).write_text(json.dumps(content), "utf-8")


def said(settings: Any, operator: str = "resume_job") -> str:
    """What the panel's button answers."""
    with pytest.raises(RuntimeError) as raised:
        getattr(bpy.ops.dgs, operator)()
    return str(raised.value)


#: Changes of a good job.json, and what of them is named.
HOSTILE = {
    "an option that is none": ({"options": {"out": "/tmp/elsewhere"}}, "'out'"),
    "an option of another job": ({"kind": "cameras", "options": {"seed": 1}}, "'seed'"),
    "a command": ({"kind": "render"}, "kind is none of"),
    "a key that is none": ({"command": ["sh", "-c", "touch /tmp/x"]}, "'command'"),
    "an option-like path": ({"options": {"cameras": "--overwrite"}}, "cameras cannot be '--overwrite'"),
    "option-like photos": ({"photos": "--rollback"}, "photos is no absolute path"),
    "relative photos": ({"photos": "../../etc"}, "photos is no absolute path"),
    "a number as text": ({"options": {"seed": "1"}}, "seed cannot be '1'"),
    "a switch with a value": ({"options": {"snapshots": "yes"}}, "snapshots cannot be"),
    "true as a number": ({"options": {"threads": True}}, "threads cannot be True"),
    "too large": ({"options": {"threads": 2**40}}, "threads cannot be"),
    "another choice": ({"options": {"preset": "--help"}}, "preset cannot be '--help'"),
    "another device": ({"options": {"device": "tpu"}}, "device cannot be"),
    "another effect": ({"options": {"effects": "none --out /x"}}, "effects cannot be"),
    "a point spread of another kind": ({"options": {"psf": "per-photo:/etc/passwd"}}, "psf cannot be"),
    "a kernel beside us": ({"options": {"psf": "file:kernel.npy"}}, "psf cannot be"),
    "a line break": ({"options": {"cameras": "/a\n/b"}}, "cameras cannot be"),
    "no list of options": ({"options": ["--psf", "none"]}, "options is no object"),
    "a chosen path": ({"selection": "a.png\n../b.png"}, "selection is no chosen names"),
    "no phase": ({"phase": 3}, "phase is none of"),
    "no process": ({"pid": -1}, "pid is no process"),
    "no result": ({"result": {"registered": [1]}}, "result.registered is no sentence"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_job_is_refused_in_the_panel(settings: Any, photo_set: Path, tmp_path: Path, case: str) -> None:
    changes, words = HOSTILE[case]
    write(tmp_path / "out", job(photo_set, **changes))
    record, text = runner.unfinished(tmp_path / "out")  # what the panel shows; a button's own answer is cut off
    assert record is None
    assert words in text and NAME in text and "Press Optimize to begin anew" in text
    assert NAME in said(settings)


def test_another_command_in_the_file_is_not_run(settings: Any, photo_set: Path, tmp_path: Path) -> None:
    """As the panel did once: `render` over the user's photos, at a --out of the file's."""
    victim = tmp_path / "victim"
    shutil.copytree(photo_set / "photos", victim)
    before = {path.name: path.read_bytes() for path in victim.iterdir()}
    twin, model = tmp_path / "twin.ply", str(photo_set / "model")
    arguments = ["render", str(twin), "--cameras", model, "--out", str(victim), "--overwrite"]
    write(tmp_path / "out", old_job(photo_set, arguments))
    assert NAME in said(settings) and "'--overwrite'" in runner.unfinished(tmp_path / "out")[1]
    arguments = ["update", str(victim), "--rollback"]
    write(tmp_path / "out", old_job(photo_set, arguments))
    assert NAME in said(settings) and "'--rollback'" in runner.unfinished(tmp_path / "out")[1]
    assert {path.name: path.read_bytes() for path in victim.iterdir()} == before


def test_the_results_go_where_the_user_wants_them_and_nowhere_else(
    settings: Any, photo_set: Path, tmp_path: Path
) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    arguments = ["synthesize", "/nowhere", "--out", str(elsewhere), "--psf", f"gaussian:{SIGMA:g}"]
    arguments += ["--cameras", str(photo_set / "model"), "--preset", "draft", "--max-gaussians", "1000"]
    arguments += ["--holdout-every", "4", "--threads", "1", "--progress", "json", "--control"]
    write(out, old_job(photo_set, arguments))
    settings.photos, settings.out = "", str(out)  # a new Blender, and only the folder is chosen
    assert bpy.ops.dgs.resume_job() == {"FINISHED"}
    assert (out / "twin.ply").is_file() and not elsewhere.exists()
    assert json.loads((out / "report.json").read_text("utf-8"))["settings"]["run"]["out"] == str(out)


def test_jobs_of_the_version_before_are_understood(settings: Any, photo_set: Path, tmp_path: Path) -> None:
    settings.max_size, settings.time_limit, settings.sh_degree = 64, 1.5, "0"
    settings.adjust_cameras = "never"
    settings.refine_cameras, settings.effects, settings.truth = True, "auto", str(photo_set / "photos")
    settings.masks, settings.seed, settings.device = str(photo_set), 7, "cpu"
    request = request_of("reconstruct", bpy.context.scene)
    assert options_of(request.arguments) == request.options
    write(tmp_path / "out", old_job(photo_set, [*request.arguments, "--resume"]))
    record = read_record(tmp_path / "out")
    again = resumed_request(record, tmp_path / "out")
    assert again.arguments == request.arguments and again.resume
    settings.cameras = "photos"
    request = request_of("cameras", bpy.context.scene)
    Record("cameras", str(request.photos), 5, request.options, phase="failed").save(tmp_path / "out")
    assert read_record(tmp_path / "out").options == request.options


def test_every_option_is_one_that_the_command_line_has(photo_set: Path, tmp_path: Path) -> None:
    from dgs.command_line.main import build_parser

    values: dict[str, Any] = {
        "psf": "gaussian:2,1,-30",
        "blur_space": "linear",
        "masks": "/m",
        "max_size": 32,
        "frames": 9,
        "cameras": "/c",
        "preset": "fine",
        "holdout_every": 0,
        "seed": 3,
        "max_gaussians": 500,
        "effects": "auto",
        "background": "white",
        "adjust_cameras": "always",
        "refine_cameras": True,
        "time_limit": 90.0,
        "sh_degree": 2,
        "truth": "/t",
        "snapshots": True,
        "device": "cpu",
        "threads": 2,
    }
    assert values.keys() == OPTIONS.keys()
    for kind in ("cameras", "reconstruct"):
        own = {name: value for name, value in values.items() if OPTIONS[name].only in ("", kind)}
        check_options(kind, own)
        arguments = job_arguments(kind, Path("/p"), Path("/o"), own)
        parsed = vars(build_parser(arguments).parse_args(arguments))
        assert parsed["out"] == Path("/o") and parsed["photos"] == Path("/p") and parsed["control"]
        for name, value in own.items():
            assert parsed[name] == (Path(value) if isinstance(parsed[name], Path) else value), name
        assert options_of(arguments) == own


def test_a_job_whose_photos_are_gone_is_explained(settings: Any, photo_set: Path, tmp_path: Path) -> None:
    write(tmp_path / "out", job(photo_set, photos="/nowhere"))
    assert "The job's photos in '/nowhere' cannot be used" in said(settings)


def test_a_job_that_is_too_large_or_a_pipe_is_refused_at_once(settings: Any, photo_set: Path, tmp_path: Path) -> None:
    write(tmp_path / "out", job(photo_set, error="x" * 2**20))
    with pytest.raises(FormatError, match="larger than 1 MiB"):
        read_record(tmp_path / "out")
    (tmp_path / "out" / NAME).unlink()
    os.mkfifo(tmp_path / "out" / NAME)
    assert NAME in said(settings) and "no file that ends" in runner.unfinished(tmp_path / "out")[1]


# --- folders that hold files of others ---


def test_files_of_others_are_replaced_only_after_a_yes(settings: Any, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "cameras").mkdir()
    (out / "cameras" / "mine.txt").write_text("mine", "utf-8")
    (out / "twin.ply").write_bytes(b"mine")
    text = said(settings, "optimize")
    assert "files that this program did not write, such as 'cameras'" in text and "replace=True" in text
    assert "--overwrite" not in text, "a panel has no options"
    assert (out / "twin.ply").read_bytes() == b"mine" and not (out / NAME).exists(), "nothing was written yet"
    with pytest.raises(RuntimeError, match="did not write"):  # the yes was about another folder
        bpy.ops.dgs.optimize(replace=True, asked_folder=str(tmp_path))
    assert (out / "twin.ply").read_bytes() == b"mine"
    assert bpy.ops.dgs.optimize(replace=True, asked_folder=str(out)) == {"FINISHED"}
    assert (out / "twin.ply").read_bytes()[:3] == b"ply"
    assert foreign_files("reconstruct", out) == ""
    assert not runner.current().request.arguments.count("--overwrite"), "a yes is not kept in the record"


def test_a_list_of_chosen_photos_of_the_users_own_stays(settings: Any, tmp_path: Path) -> None:
    (tmp_path / "out" / "photos.txt").write_text("my own notes", "utf-8")
    names = sorted(path.name for path in Path(settings.photos).iterdir())[:3]
    settings.selection = "\n".join(names)
    request = request_of("reconstruct", bpy.context.scene)
    assert (tmp_path / "out" / "photos.txt").read_text("utf-8") == "my own notes"
    listed = Path(request.arguments[1])
    settings.selection = "\n".join(names[1:] + [sorted(p.name for p in Path(settings.photos).iterdir())[4]])
    assert Path(request_of("reconstruct", bpy.context.scene).arguments[1]) != listed
    assert [Path(line).name for line in listed.read_text("utf-8").splitlines()] == names, "a twin's list stays"


def test_a_test_set_into_a_folder_of_others_asks_first(settings: Any, tmp_path: Path) -> None:
    folder = tmp_path / "holiday"
    (folder / "photos").mkdir(parents=True)
    (folder / "photos" / "view_001.png").write_bytes(b"mine")
    settings.test_set = str(folder)
    assert "such as 'photos'" in said(settings, "make_test_set")
    assert [path.name for path in folder.iterdir()] == ["photos"]
    assert foreign_files("synthesize", folder) and not foreign_files("cameras", out_folder(settings))
