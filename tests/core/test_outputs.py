"""Outputs never replace inputs, nor what somebody else made."""

import hashlib

import pytest
from dgs.command_line.main import run
from dgs.core.errors import OutputError
from dgs.core.lock import working_on
from dgs.core.outputs import (
    LIST,
    check_output_folder,
    check_outputs,
    claim_output_folder,
    note_output,
    placing_output,
    placing_outputs,
)
from dgs.core.run_settings import RUN_REPLACES
from dgs.core.twin.folder import PARTS
from dgs.tests.crashes import crashes
from PIL import Image


@pytest.fixture
def file(tmp_path):
    (tmp_path / "a.png").write_bytes(b"mine")
    return tmp_path / "a.png"


def test_somebody_elses_file_is_replaced_only_where_it_is_allowed(file):
    check_outputs([file.with_name("new.png")])
    with pytest.raises(OutputError, match=r"a\.png' is there already.*--overwrite"):
        check_outputs([file])
    check_outputs([file], overwrite=True)


def test_our_own_file_is_replaced_until_somebody_changes_it(file):
    note_output(file)
    check_outputs([file])
    file.write_bytes(b"hand-made")
    with pytest.raises(OutputError, match="changed since"):
        check_outputs([file])


def test_an_input_is_never_replaced(file):
    note_output(file)
    link = file.with_name("link.png")
    link.symlink_to(file)
    for written in (file, link, file.parent / "x" / ".." / "a.png"):
        (file.parent / "x").mkdir(exist_ok=True)
        with pytest.raises(OutputError, match="is read by this command"):
            check_outputs([written], [file], overwrite=True)


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(OutputError, match="is a folder"):
        check_outputs([tmp_path], overwrite=True)


def test_a_folder_of_others_is_refused_and_an_empty_one_becomes_ours(tmp_path, file):
    with pytest.raises(OutputError, match="holds files that this program did not write"):
        check_output_folder(tmp_path, ("compare.json",))
    check_output_folder(tmp_path, ("a.png",))
    new = tmp_path / "new"
    check_output_folder(new, ())
    claim_output_folder(new)
    (new / "row.json").write_text("{}")
    check_output_folder(new, ())


def render(folder, content):
    """Three pictures, one of them in a folder of its own."""
    with placing_outputs(folder, "render", print) as made:
        (made / "inner").mkdir()
        for name in ("a.png", "b.png", "inner/c.png"):
            (made / name).write_text(content)


@pytest.mark.parametrize("fault", ["kill", "full"])
def test_several_files_are_placed_and_listed_together_or_not_at_all(memory_path, fault):
    folder, outcomes = memory_path / "out", []
    render(folder, "old")
    for _ in crashes(lambda: render(folder, "new"), folder, fault, OutputError):
        with working_on(folder, "look", print):
            pass
        files = [folder / name for name in ("a.png", "b.png", "inner/c.png")]
        (content,) = {file.read_text() for file in files}
        outcomes.append(content)
        check_outputs(files)
        render(folder, "old")
    assert set(outcomes) == {"old", "new"} if fault == "kill" else "old" in outcomes


@pytest.mark.parametrize("fault", ["kill", "full"])
def test_a_file_that_was_cut_off_while_it_was_placed_may_be_replaced(memory_path, fault):
    file = memory_path / "twin.blend"

    def write(content):
        with placing_output(file) as temporary:
            temporary.write_text(content)

    write("old")
    for _ in crashes(lambda: write("new"), memory_path, fault, OutputError):
        assert file.read_text() in ("old", "new")
        check_outputs([file])
        write("old")


def test_a_line_of_the_list_that_was_cut_off_spoils_no_other(file):
    note_output(file)
    with (file.parent / LIST).open("a") as listed:
        listed.write("0123abc")
    file.write_bytes(b"next")
    note_output(file)
    check_outputs([file])
    assert (file.parent / LIST).read_text().count("\n") == 3


def said(capsys, *words):
    assert run([str(word) for word in words]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize("name", ["p.tif", "p_picture.png"])
def test_measure_psf_keeps_the_photo(name, tmp_path, capsys):
    """The photo, or a picture of the kernel's name, was overwritten."""
    photo = tmp_path / name
    Image.new("L", (64, 64), 40).save(photo)
    before = photo.read_bytes()
    assert "is read by this command" in said(capsys, "measure-psf", photo, "--out", tmp_path / "p.tif", "--overwrite")
    assert photo.read_bytes() == before


def test_blend_replaces_no_twin(file, tmp_path, capsys):
    twin = tmp_path / "twin.ply"
    twin.write_bytes(b"ply")
    assert "ends in .blend" in said(capsys, "blend", twin, "--out", tmp_path / "other.ply", "--overwrite")
    (tmp_path / "scene.blend").write_bytes(b"hand-made")
    assert "--overwrite" in said(capsys, "blend", twin, "--out", tmp_path / "scene.blend")
    assert (tmp_path / "scene.blend").read_bytes() == b"hand-made"


@pytest.mark.parametrize("command", ["compare", "tradeoff"])
def test_studies_take_no_folder_of_others(command, file, tmp_path, capsys):
    line = said(capsys, command, tmp_path / "set", "--out", tmp_path)
    assert "holds files that this program did not write" in line


def test_stress_writes_no_tables_over_a_document_or_a_folder(tmp_path, capsys):
    words = ("stress", "--only", "psf", "--markdown")
    assert "is a folder" in said(capsys, *words, tmp_path)
    (tmp_path / "letter.md").write_text("Dear")
    assert "--overwrite" in said(capsys, *words, tmp_path / "letter.md")


def test_stress_says_that_no_case_has_the_name(capsys):
    """'0 of 0 hold', status 0."""
    assert "No case is called 'zzzz'" in said(capsys, "stress", "--only", "zzzz")


def test_render_keeps_photos(tmp_path, capsys):
    import numpy as np
    from dgs.core.camera import Camera
    from dgs.core.formats.gaussians import write_gaussians
    from dgs.core.formats.transforms import write_transforms
    from dgs.studies.stability.fuzzed_samples import cloud

    write_gaussians(tmp_path / "twin.ply", cloud())
    camera = Camera("a.png", 20, 16, 20.0, 20.0, 10.0, 8.0, np.eye(3), np.array([0.0, 0.0, 5.0]))
    other = Camera("b.png", 20, 16, 20.0, 20.0, 10.0, 8.0, np.eye(3), np.array([1.0, 0.0, 5.0]))
    write_transforms(tmp_path / "transforms.json", {"a.png": camera, "b.png": other})
    photos = tmp_path / "photos"
    photos.mkdir()
    Image.new("RGB", (20, 16)).save(photos / "a.png")
    before = (photos / "a.png").read_bytes()
    words = ["render", str(tmp_path / "twin.ply"), "--cameras", str(tmp_path / "transforms.json"), "--out"]
    assert "a.png' is there already" in said(capsys, *words, photos)
    assert (photos / "a.png").read_bytes() == before and not (photos / "b.png").exists()
    for _ in range(2):  # the second time it replaces its own
        assert run([*words, str(tmp_path / "out"), "--progress", "none"]) == 0
    assert run([*words, str(photos), "--overwrite", "--progress", "none"]) == 0
    assert (photos / "a.png").read_bytes() != before


@pytest.mark.parametrize("command", ["reconstruct", "cameras"])
def test_a_run_replaces_no_cameras_of_others(command, tmp_path, capsys):
    """A data set's own folder as --out lost its camera model."""
    (tmp_path / "photos").mkdir()
    for name in ("a.png", "b.png", "c.png"):
        Image.new("RGB", (40, 30)).save(tmp_path / "photos" / name)
    (tmp_path / "cameras").mkdir()
    (tmp_path / "cameras" / "cameras.txt").write_text("mine")
    line = said(capsys, command, tmp_path / "photos", "--out", tmp_path, "--progress", "none")
    assert "such as 'cameras'" in line and "--overwrite" in line
    assert (tmp_path / "cameras" / "cameras.txt").read_text() == "mine"


def test_what_a_run_replaces_is_what_it_leaves():
    assert tuple(part.name for part in PARTS if not part.lasting) == RUN_REPLACES


def test_the_list_is_as_sha256sum_writes_it(file):
    note_output(file)
    claim_output_folder(file.parent)
    lines = (file.parent / ".dgs-written").read_text("utf-8").splitlines()
    assert lines == [f"{hashlib.sha256(b'mine').hexdigest()}  a.png"]


def test_how_many_more_are_in_the_way_is_said(file):
    others = [file, file.with_name("b.png"), file.with_name("c.png")]
    for other in others[1:]:
        other.write_bytes(b"theirs")
    with pytest.raises(OutputError, match=r"a\.png' is there already"):
        check_outputs(others[:1])
    with pytest.raises(OutputError, match=r"\(and 2 more files\)"):
        check_outputs(others)
    note_output(file)
    with pytest.raises(OutputError, match=r"b\.png' \(and 1 more files\)"):
        check_outputs(others)


def test_a_broken_link_is_somebody_elses(tmp_path):
    (tmp_path / "link.png").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="there already"):
        check_outputs([tmp_path / "link.png"])


def test_only_what_will_be_replaced_stands_in_the_way(tmp_path, file):
    check_output_folder(tmp_path, (), replaced=["b.png"])
    with pytest.raises(OutputError, match=r"such as 'a\.png'"):
        check_output_folder(tmp_path, (), replaced=["a.png", "b.png"])
    check_output_folder(tmp_path, (), overwrite=True, replaced=["a.png"])
    for name in ("job.json", "job.log", ".hidden"):
        (tmp_path / "own").mkdir(exist_ok=True)
        (tmp_path / "own" / name).write_text("")
    check_output_folder(tmp_path / "own", ())
    check_output_folder(tmp_path / "not there", ())


def test_a_list_that_cannot_be_written_is_named(tmp_path, file):
    (tmp_path / ".dgs-written").mkdir()
    with pytest.raises(OutputError, match=r"\.dgs-written"):
        note_output(file)
    with pytest.raises(OutputError, match="there already"):
        check_outputs([file])
