"""Every button: why it cannot be pressed, and what it says where it fails."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import operators  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats.ply import read_ply, write_ply  # noqa: E402
from dgs.dgs_addon.paths import chosen_photos, out_folder, pictures_folder  # noqa: E402
from dgs.dgs_addon.photos import forget  # noqa: E402


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


def refused(operator: str, words: str, **arguments: object) -> None:
    """The operator cannot run, or fails, and says why."""
    name = operator.removeprefix("dgs.")
    with pytest.raises(RuntimeError, match=words):
        getattr(bpy.ops.dgs, name)(**arguments)


#: What each button says in an empty scene.
MISSING = {
    "find_cameras": "Choose the folder of photos first",
    "optimize": "Choose the folder of photos first",
    "show_cameras": "No cameras yet",
    "resume_job": "There is no unfinished job",
    "pause_job": "No job is running",
    "cancel_job": "No job is running",
    "show_log": "No job has run yet",
    "add_results": "Choose the folder of photos first",
    "cancel_batch": "No batch is running",
    "take_set": "No batch has made twins yet",
    "export_twin": "Select a twin first",
    "mark_assets": "Select a twin first",
    "edit_splats": "Select a twin first",
    "select_by_size": "Select a twin first",
    "select_by_opacity": "Select a twin first",
    "select_by_colour": "Select a twin first",
    "select_by_error": "Select a twin first",
    "select_floaters": "Select a twin first",
    "delete_splats": "Select splats in Edit Mode first",
    "hide_splats": "Select splats in Edit Mode first",
    "show_splats": "Select splats in Edit Mode first",
    "restore_splats": "Select a twin first",
    "merge_twins": "Select two twins or more in Object Mode",
    "apply_transform": "Select a twin in Object Mode",
    "view_twin": "There is no twin",
    "render_twin": "There is no twin",
    "composite_meshes": "There is no twin",
    "exact_view": "There is no twin",
    "split_view": "There is no twin",
    "set_length": "There is no twin",
    "set_up": "There is no twin",
    "crop_twin": "There is no twin",
    "give_back": "Nothing of this scene was changed",
    "limit_splats": "There is no twin",
    "open_report": "There is no report yet",
    "inspect_photos": "Choose the folder of photos first",
    "estimate": "Choose the folder of photos first",
    "show_known": "Select a twin",
    "suggest_next_views": "There is no twin yet",
    "remove_twin": "Select a twin first",
    "show_next_views": "No suggestions yet",
    "make_test_set": "Choose a folder for the test set first",
    "compare_truth": "Choose the folder of photos first",
    "update_twin": "There is no twin yet",
    "rollback_twin": "There is no twin yet",
    "show_states": "There is no twin yet",
    "use_inspection": "Press Inspect Photos first",
    "measure": "Select a twin",
    "measure_again": "Select a twin",
    "remove_measure": "Measure something first",
    "export_measures": "Measure something first",
    "know_length": "Choose a length",
    "scale_by_board": "Select a twin",
    "forget_length": "No length is known",
    "make_mesh": "Select a twin",
    "compare_earlier": "Select a twin",
    "show_changes": "Select a twin",
    "install_engine": "Only an installed extension",
    "cancel_install": "Nothing is running",
    "open_preferences": "not enabled",
}
#: Buttons that an empty scene does not hinder.
ALWAYS = {
    "add_preset",
    "batch",
    "open_manual",
    "import_twin",
    "import_cameras",
    "prepare_scene",
    "choose_photos",
    "show_tradeoff",
    "check_engine",
    "measure_psf",
    "dismiss",
}


@pytest.mark.parametrize(("operator", "words"), MISSING.items())
def test_in_an_empty_scene_a_button_says_what_is_missing(operator: str, words: str) -> None:
    refused(operator, words)


def test_no_button_is_forgotten_and_each_has_a_tooltip() -> None:
    kinds = [kind for kind in operators.CLASSES if issubclass(kind, bpy.types.Operator)]
    assert {kind.bl_idname.removeprefix("dgs.") for kind in kinds} == MISSING.keys() | ALWAYS
    assert not MISSING.keys() & ALWAYS
    for name in ALWAYS:
        assert getattr(bpy.ops.dgs, name).poll(), name
    for kind in kinds:
        assert kind.__doc__ and not kind.__doc__.endswith("."), "a tooltip has no full stop"


def test_photos_that_are_not_there_are_refused(tmp_path: Path) -> None:
    refused("choose_photos", "There is no folder", directory=str(tmp_path / "nowhere"))
    refused("choose_photos", "No photos here", directory=str(tmp_path))
    assert bpy.context.scene.dgs.photos == ""


def test_photos_with_alpha_are_counted(tmp_path: Path) -> None:
    def header(kind: int, more: bytes = b"") -> bytes:
        return b"\x89PNG" + bytes(12) + struct.pack(">IIBB", 30, 20, 8, kind) + bytes(7) + more + b"IDAT" + bytes(40)

    for name, content in (
        ("a", header(6)),
        ("b", header(4)),
        ("c", header(2)),
        ("d", header(3, b"PLTE" + bytes(768) + b"tRNS")),
        ("e", header(3, b"PLTE" + bytes(768))),
    ):
        (tmp_path / f"{name}.png").write_bytes(content)
    settings = bpy.context.scene.dgs
    assert choose(tmp_path, "a.png") == {"FINISHED"}
    assert chosen_photos(settings).with_alpha == 3


def choose(folder: Path, *names: str) -> set[str]:
    return bpy.ops.dgs.choose_photos(directory=str(folder), files=[{"name": name} for name in names])


def test_a_folder_some_of_its_photos_or_a_movie_may_be_chosen(tmp_path: Path) -> None:
    for name in "abcdef":
        (tmp_path / f"{name}.png").write_bytes(b"\x89PNG" + bytes(12) + struct.pack(">II", 30, 20))
    (tmp_path / "walk.MOV").write_bytes(b"movie")
    settings = bpy.context.scene.dgs
    assert choose(tmp_path, "b.png") == {"FINISHED"}  # one photo stands for its folder
    assert settings.selection == "" and len(chosen_photos(settings).files) == 6
    assert choose(tmp_path, "d.png", "a.png", "c.png", "f.png", "notes.txt") == {"FINISHED"}
    assert [path.stem for path in chosen_photos(settings).files] == ["a", "c", "d", "f"]
    (tmp_path / "c.png").unlink()
    forget()
    assert "c.png: it is not there any more" in chosen_photos(settings).warnings
    (tmp_path / "d.png").unlink()
    forget()
    refused("optimize", "Only 2 photos here")
    assert choose(tmp_path, "walk.MOV") == {"FINISHED"}
    assert chosen_photos(settings).movie == tmp_path / "walk.MOV" and settings.selection == ""
    assert out_folder(settings) == tmp_path / "walk-twin"
    assert pictures_folder(settings) == tmp_path / "walk-twin" / "frames"
    settings.photos = str(tmp_path)
    assert pictures_folder(settings) == tmp_path and chosen_photos(settings).movie is None
    (tmp_path / "empty.mp4").write_bytes(b"")
    refused("choose_photos", "empty", directory=str(tmp_path), files=[{"name": "empty.mp4"}])


def test_few_photos_are_chosen_but_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "one.png").write_bytes(b"\x89PNG" + bytes(40))
    assert bpy.ops.dgs.choose_photos(directory=str(tmp_path)) == {"FINISHED"}
    refused("optimize", "Only 1 photo here")


def test_without_an_engine_the_button_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in "abc":
        (tmp_path / f"{name}.png").write_bytes(b"\x89PNG" + bytes(40))
    bpy.context.scene.dgs.photos = str(tmp_path)
    monkeypatch.setenv("DGS_ENGINE_PYTHON", str(tmp_path / "no python"))
    refused("optimize", "is not there")
    refused("check_engine", "is not there")


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "broken.ply").write_bytes(b"ply\nnonsense")
    refused("import_twin", "broken.ply", filepath=str(tmp_path / "broken.ply"))
    refused("import_cameras", "cameras", filepath=str(tmp_path / "nothing.bin"))
    (tmp_path / "photos-twin").mkdir()
    (tmp_path / "photos-twin" / "twin.ply").write_bytes(b"ply\nnonsense")
    bpy.context.scene.dgs.photos = str(tmp_path / "photos")
    refused("add_results", "twin.ply")
    (tmp_path / "photos-twin" / "cameras").mkdir()
    refused("show_cameras", "cameras")


def test_what_is_exported_is_what_was_imported(cloud: GaussianCloud, tmp_path: Path) -> None:
    write_ply(tmp_path / "in.ply", cloud)
    bpy.ops.dgs.import_twin(filepath=str(tmp_path / "in.ply"))
    refused("export_twin", "Cannot write|cannot be written", filepath=str(tmp_path / "in.ply" / "out.ply"))
    assert bpy.ops.dgs.export_twin(filepath=str(tmp_path / "out.ply")) == {"FINISHED"}
    out = read_ply(tmp_path / "out.ply")
    assert out.means.tobytes() == cloud.means.tobytes() and out.sh.tobytes() == cloud.sh.tobytes()


@pytest.mark.parametrize("ending", [".spz", ".splat", ".glb"])
def test_small_formats_come_and_go(cloud: GaussianCloud, tmp_path: Path, ending: str) -> None:
    write_ply(tmp_path / "in.ply", cloud)
    bpy.ops.dgs.import_twin(filepath=str(tmp_path / "in.ply"))
    assert bpy.ops.dgs.export_twin(filepath=str(tmp_path / f"out{ending}"), format=ending) == {"FINISHED"}
    assert bpy.ops.dgs.import_twin(filepath=str(tmp_path / f"out{ending}")) == {"FINISHED"}
    assert len(bpy.context.object.data.vertices) == len(cloud)
    refused("import_twin", "known ending", filepath=str(tmp_path / "out.obj"))


def test_a_render_without_a_camera_is_refused(cloud: GaussianCloud, tmp_path: Path) -> None:
    write_ply(tmp_path / "in.ply", cloud)
    bpy.ops.dgs.import_twin(filepath=str(tmp_path / "in.ply"))
    refused("render_twin", "no camera")


def test_the_log_becomes_a_text(tmp_path: Path) -> None:
    (tmp_path / "photos-twin").mkdir()
    (tmp_path / "photos-twin" / "job.log").write_text("words of the engine", "utf-8")
    bpy.context.scene.dgs.photos = str(tmp_path / "photos")
    assert bpy.ops.dgs.show_log() == {"FINISHED"}
    assert "words of the engine" in bpy.data.texts["Descatter Log"].as_string()


def test_a_chart_that_is_not_there_is_explained(tmp_path: Path) -> None:
    refused("show_tradeoff", "make one with", filepath=str(tmp_path))


def test_heic_counts_where_the_engine_reads_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The panel and the engine agree, whether pillow-heif is in the engine's Python or not."""
    engine = tmp_path / "venv"
    (engine / "bin").mkdir(parents=True)
    (engine / "lib" / "python3.11" / "site-packages").mkdir(parents=True)
    (engine / "bin" / "python").write_text("", "utf-8")
    monkeypatch.setenv("DGS_ENGINE_PYTHON", str(engine / "bin" / "python"))
    photos = tmp_path / "photos"
    photos.mkdir()
    for name in "abc":
        (photos / f"{name}.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(20))
    (photos / "d.gif").write_bytes(b"GIF89a")
    settings = bpy.context.scene.dgs
    settings.photos = str(photos)
    assert "No photos here" in chosen_photos(settings).problem
    assert "a.HEIC: HEIC needs the package pillow-heif" in chosen_photos(settings).problem
    refused("choose_photos", "pillow-heif", directory=str(photos))
    (engine / "lib" / "python3.11" / "site-packages" / "pillow_heif").mkdir()
    forget()
    found = chosen_photos(settings)
    assert [path.name for path in found.files] == ["a.HEIC", "b.HEIC", "c.HEIC"] and not found.problem
    assert found.warnings == ("d.gif: pictures of this kind are not read, it will be left out",)
    assert choose(photos, "a.HEIC", "b.HEIC", "c.HEIC") == {"FINISHED"}
    assert settings.selection == "a.HEIC\nb.HEIC\nc.HEIC"
    (photos / "c.HEIC").write_bytes(b"no picture at all")
    forget()
    assert "c.HEIC: no photo inside, it will be left out" in chosen_photos(settings).problem
