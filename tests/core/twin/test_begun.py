"""A run's folder inside the twin's: begun, cut off, gone on with, finished as one change."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
from dgs.core.errors import CheckpointError, FormatError, OutputError
from dgs.core.files import write_text
from dgs.core.transaction import recover
from dgs.core.twin.begun import CONTINUES, RUN, RUN_OLD, BegunRun
from dgs.core.twin.folder import FORMER, PARTS, Part, TwinFolder
from dgs.tests.crashes import crashes

PHOTOS = {"a.png": "0" * 64, "b.png": "1" * 64}


def seen(folder: Path) -> dict[str, str]:
    """Every file of the twin, by name; none of a run's."""
    files = {file.relative_to(folder).as_posix(): file for file in folder.rglob("*") if file.is_file()}
    return {name: file.read_text("utf-8") for name, file in files.items() if not name.startswith(".")}


def whole_twin(folder: Path, parts: Iterable[Part] = PARTS) -> TwinFolder:
    """A twin of run A, with every part or with some."""
    shutil.rmtree(folder, ignore_errors=True)
    for part in parts:
        file = folder / part.name / "in" / "one" if part.folder else folder / part.name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"A {part.name}", "utf-8")
    return TwinFolder(folder)


WRITTEN = ("cameras/images.bin", "twin.ply", "report.json", "renders/b.png", "checkpoint.npz", "report.html")


def written(begun: BegunRun, text: str = "B", count: int = 6) -> None:
    """What a short run writes, without any training."""
    for name in WRITTEN[:count]:
        write_text(begun.folder.path / name, f"{text} {name}")


def run_b(folder: Path, count: int = 6) -> None:
    """Run B into the folder, from its start to its end."""
    begun = BegunRun(TwinFolder(folder), "anew")
    begun.check_photos(PHOTOS, None)
    written(begun, count=count)
    begun.finish()


LASTING = {"photos/in/one": "A photos", "history/in/one": "A history"}


def test_all_of_the_old_twin_goes_to_history_but_what_lasts(tmp_path):
    whole_twin(tmp_path)
    before = seen(tmp_path)
    run_b(tmp_path)
    after = seen(tmp_path)
    new = {name: text for name, text in after.items() if not name.startswith("history/") and name not in LASTING}
    assert set(new) == {
        "cameras/images.bin",
        "twin.ply",
        "checkpoint.npz",
        "renders/b.png",
        "report.json",
        "report.html",
        "inputs.json",
    }
    assert all(text.startswith("B ") for name, text in new.items() if name != "inputs.json")
    kept = {name: text for name, text in after.items() if name.startswith("history/") and name not in LASTING}
    assert kept.pop(f"history/000/{FORMER}")
    assert kept == {f"history/000/{name}": text for name, text in before.items() if name not in LASTING}
    TwinFolder(tmp_path).rollback()
    assert seen(tmp_path) == before


@pytest.mark.parametrize("fault", ["kill", "full"])
def test_cut_off_anywhere_it_is_the_old_twin_or_the_new_one(memory_path, fault):
    folder = memory_path / "t"
    few = [part for part in PARTS if part.name in {"photos.txt", "cameras", "twin.ply", "report.json", "history"}]
    before = seen(whole_twin(folder, few).path)
    run_b(folder, 3)
    after, outcomes = seen(folder), []
    whole_twin(folder, few)
    for _ in crashes(lambda: run_b(folder, 3), folder, fault, OutputError):
        recover(folder)
        found = seen(folder)
        assert found in (before, after)
        outcomes.append(found == after)
        if len(outcomes) % 5 == 0:  # whatever is left is in nobody's way
            run_b(folder, 3)
            assert {name: text for name, text in seen(folder).items() if "/00" not in name}.items() <= after.items()
            assert not [path.name for path in folder.iterdir() if path.name.startswith(".")]
        whole_twin(folder, few)
    assert outcomes == sorted(outcomes) and outcomes.count(False) > 20


def test_cut_off_before_its_end_it_is_gone_on_with(tmp_path):
    folder = TwinFolder(tmp_path)
    begun = BegunRun(folder, "anew")
    begun.check_photos(PHOTOS, "given")
    written(begun)
    again = BegunRun(folder, "resume")
    again.check_photos(PHOTOS, "given")
    assert again.folder.checkpoint.read_text("utf-8") == "B checkpoint.npz"
    with pytest.raises(CheckpointError, match=r"'b\.png' \(or its mask\) is not the photo"):
        again.check_photos({**PHOTOS, "b.png": "2" * 64}, "given")
    with pytest.raises(CheckpointError, match="other cameras"):
        again.check_photos(PHOTOS, "others")
    again.check_photos(PHOTOS, None)
    (again.folder.path / "inputs.json").unlink()
    with pytest.raises(CheckpointError, match="earlier version"):
        again.check_photos(PHOTOS, None)
    (again.folder.path / "inputs.json").write_text("[]")
    with pytest.raises(FormatError, match="damaged"):
        again.check_photos(PHOTOS, None)


def test_a_start_takes_over_what_it_may(tmp_path):
    folder = whole_twin(tmp_path)
    folder.save_inputs(PHOTOS, None)
    names = lambda begun: {path.name for path in begun.folder.path.iterdir()}  # noqa: E731
    assert names(BegunRun(folder, "anew")) == set()
    assert names(BegunRun(folder, "anew", movie=True)) == {"frames"}
    assert names(BegunRun(folder, "cameras")) == {"cameras", "sfm", "inputs.json"}
    shutil.rmtree(tmp_path / RUN)
    taken = {"cameras", "sfm", "inputs.json", "photos.txt", "checkpoint.npz", "trials.json", "plan.json", CONTINUES}
    assert names(BegunRun(folder, "resume")) == taken
    again = BegunRun(folder, "resume")
    again.check_photos({}, None)
    written(again, "C")
    assert seen(tmp_path)["cameras/in/one"] == "A cameras", "what is taken over is nobody else's"
    assert "images.bin" in {path.name for path in BegunRun(folder, "cameras").folder.camera_folder.iterdir()}


def test_a_twin_that_is_gone_on_with_is_kept_only_if_it_was_updated_meanwhile(tmp_path):
    folder = whole_twin(tmp_path)
    folder.save_inputs(PHOTOS, None)
    begun = BegunRun(folder, "resume")
    begun.check_photos(PHOTOS, None)
    written(begun)
    BegunRun(folder, "resume").finish()
    assert folder.states() == [] and seen(tmp_path)["twin.ply"] == "B twin.ply"
    begun = BegunRun(folder, "resume")
    begun.check_photos(PHOTOS, None)
    written(begun, "C")
    folder.save_update_log({"updates": []})
    BegunRun(folder, "resume").finish()
    assert [state.name for state in folder.states()] == ["000"]
    assert (folder.states()[0] / "twin.ply").read_text("utf-8") == "B twin.ply"


def test_a_run_that_never_came_to_work_gives_its_place_back(tmp_path):
    folder = TwinFolder(tmp_path)
    begun = BegunRun(folder, "anew")
    begun.check_photos(PHOTOS, None)
    written(begun)
    with pytest.raises(ZeroDivisionError), BegunRun(folder, "anew").until_finished([]):
        raise ZeroDivisionError
    assert (tmp_path / RUN / "checkpoint.npz").is_file() and not (tmp_path / RUN_OLD).exists()
    BegunRun(folder, "anew")  # cut off here
    assert BegunRun(folder, "resume").folder.checkpoint.is_file()
    later = BegunRun(folder, "anew")
    later.check_photos(PHOTOS, None)
    assert not BegunRun(folder, "resume").folder.checkpoint.exists() and not (tmp_path / RUN_OLD).exists()


@pytest.mark.parametrize("read", ["photos.txt", "frames", "frames/in/one"])
def test_what_a_run_reads_stays(tmp_path, read):
    folder = whole_twin(tmp_path)
    begun = BegunRun(folder, "anew")
    begun.check_photos(PHOTOS, None)
    written(begun)
    begun.folder.photo_list.write_text("written anew", "utf-8")
    begun.finish([tmp_path / read])
    name = read if read == "photos.txt" else "frames/in/one"
    assert seen(tmp_path)[name] == f"A {name.split('/')[0]}"


def test_a_run_that_was_gone_on_with_and_left_at_once_can_be_gone_on_with(tmp_path):
    """Before its photos were compared: what the first run found stays."""
    begun = BegunRun(TwinFolder(tmp_path), "anew")
    begun.check_photos(PHOTOS, None)
    written(begun)
    begun.leave()
    kept = begun.folder.checkpoint.read_text("utf-8")
    again = BegunRun(TwinFolder(tmp_path), "resume")
    again.leave()
    assert again.folder.checkpoint.read_text("utf-8") == kept and again.folder.camera_folder.is_dir()
