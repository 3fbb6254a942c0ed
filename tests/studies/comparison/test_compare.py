"""The whole comparison on a small rendered wall, from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.errors import TooFewPhotos
from dgs.core.files import write_json
from dgs.core.pipeline.cameras import CameraSearch
from dgs.core.progress import Silent
from dgs.core.sfm.settings import SfmSettings
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin.folder import TwinFolder
from dgs.studies.comparison.dataset import kept_cameras, load_dataset
from dgs.studies.comparison.measure import Measure
from dgs.studies.comparison.methods import CHOSEN, LUCY_MEASURED, VARIATION, WIENER_MEASURED, MethodRunner, methods
from dgs.studies.comparison.settings import CompareSettings
from dgs.tests.studies.conftest import LINE_WIDTH, SIGMA

METHODS = ("plain", "dgs", "oracle", WIENER_MEASURED, f"rl 5 {VARIATION}")


def arguments(folder, out, *more):
    only = [word for method in METHODS for word in ("--only", method)]
    return [
        "compare",
        str(folder),
        "--out",
        str(out),
        "--cameras",
        "known",
        "--quick",
        "--steps",
        "150",
        "--threads",
        "1",
        "--progress",
        "none",
        *only,
        *more,
    ]


@pytest.fixture(scope="module")
def compared(rendered_set, tmp_path_factory):
    out = tmp_path_factory.mktemp("compared")
    assert run(arguments(rendered_set, out)) == 0
    return out


def test_every_method_has_its_row_and_every_figure(compared):
    content = json.loads((compared / "compare.json").read_text())
    assert [row["method"] for row in content["rows"]] == list(METHODS)
    for row in content["rows"]:
        assert 10 < row["heldout"]["psnr"] < 60
        assert set(row["heldout"]["bands"]["14-10"]) == {"gain", "correlation", "energy"}
        assert row["lines"]["red"]["concordance"] > 0.5
        assert 0 < row["depth"]["median"] < 1 and 0 < row["depth"]["median_object"] < 1
    assert content["facts"]["poses"]["centre_px_median"] == pytest.approx(0.0, abs=1e-3)
    assert content["methods"]["without_truth"] == [WIENER_MEASURED]
    assert content["methods"]["best_rl"] == f"rl 5 {VARIATION}"


def test_descattering_beats_plain_splatting_and_the_oracle_has_the_true_width(compared):
    each = json.loads((compared / "compare.json").read_text())["methods"]["each"]
    psnr = {method: entry["median"]["psnr"] for method, entry in each.items()}
    assert psnr["oracle"] > psnr["plain"] and psnr["dgs"] > psnr["plain"]
    concordance = {method: entry["median"]["red concordance"] for method, entry in each.items()}
    assert concordance["oracle"] > concordance["plain"]


def test_table_and_pictures_are_there(compared):
    text = (compared / "compare.md").read_text()
    assert "chosen without truth" in text and "mean |rendered width - true width|" in text and "26.3" in text
    for name in ("profile.png", "crops.png", "widths.png", "bands.png", "turntable_dgs.mp4", "turntable.gif"):
        assert (compared / name).stat().st_size > 1000
        assert f"({name})" in text


def test_resume_runs_nothing_again_but_other_settings_do(compared, rendered_set):
    rows = {path: path.stat().st_mtime_ns for path in (compared / "rows").iterdir()}
    assert len(rows) == len(METHODS)
    assert run(arguments(rendered_set, compared, "--resume")) == 0
    assert {path: path.stat().st_mtime_ns for path in (compared / "rows").iterdir()} == rows
    key = json.loads(next(iter(rows)).read_text())["key"]
    other = ["--only", "plain", "--resume", "--max-gaussians", "500"]
    assert (
        run(
            [
                "compare",
                str(rendered_set),
                "--out",
                str(compared),
                "--cameras",
                "known",
                "--quick",
                "--steps",
                "5",
                "--threads",
                "1",
                "--progress",
                "none",
                *other,
            ]
        )
        == 0
    )
    assert json.loads((compared / "rows" / "plain-0.json").read_text())["key"] != key


def test_true_widths_are_those_that_were_painted(rendered_set, tmp_path):
    settings = CompareSettings(rendered_set, tmp_path, cameras="known")
    data = load_dataset(settings, 1, Silent())
    views = Measure(data).true_widths["red"]
    assert len(views) > 4
    for true in views.values():
        assert true.measured.value == pytest.approx(true.geometric, abs=0.25)
        assert true.geometric == pytest.approx(LINE_WIDTH / 4 * 130, rel=0.15)


def test_a_cropped_set_sees_the_same_world(rendered_set, tmp_path):
    data = load_dataset(CompareSettings(rendered_set, tmp_path, cameras="known"), 1, Silent())
    small = data.cropped(10, lambda photo: photo)
    name = data.photos[0].name
    whole, cut = data.truth.pixels(name), small.truth.pixels(name)
    assert np.array_equal(cut, whole[10:-10, 10:-10])
    assert small.photos[0].pixels.shape == cut.shape
    camera, before = small.cameras.cameras()[name], data.cameras.cameras()[name]
    assert (camera.cx, camera.cy, camera.width) == (before.cx - 10, before.cy - 10, before.width - 20)
    depth = small.depth(name)
    assert depth is not None and depth.shape == cut.shape[:2]
    assert small.cropped(2, lambda photo: photo).truth.border == 12


def test_no_method_trains_on_a_copy_of_a_photo_that_is_held_out(rendered_set, tmp_path):
    data = load_dataset(CompareSettings(rendered_set, tmp_path, cameras="known"), 1, Silent())
    held, copy = data.heldout[0], f"z_{data.heldout[0]}"
    first = next(photo for photo in data.photos if photo.name == held)
    cameras = replace(
        data.cameras,
        poses={**data.cameras.poses, copy: data.cameras.poses[held]},
        lenses={**data.cameras.lenses, copy: data.cameras.lenses[held]},
    )
    doubled = replace(data, photos=[*data.photos, replace(first, name=copy)], cameras=cameras)
    assert doubled.heldout == data.heldout
    base = replace(TrainingSettings(), steps=2, max_gaussians=200, threads=1)
    for method in ("plain", "wiener 1e-4 v0"):
        alone, both = (MethodRunner(each, Silent()).trained(method, base)[0] for each in (data, doubled))
        assert np.array_equal(alone.gaussians.cloud().means, both.gaussians.cloud().means)


def test_a_search_for_cameras_is_kept_with_its_time_and_read_back(rendered_set, tmp_path):
    data = load_dataset(CompareSettings(rendered_set, tmp_path, cameras="known"), 1, Silent())
    folder = TwinFolder(tmp_path / "out")
    folder.save_cameras(data.cameras)
    write_json(folder.camera_folder / "seconds.json", 12.5)
    search = CameraSearch(SfmSettings(threads=1), resume=True)
    cameras, seconds = kept_cameras(folder, data.photos, data.medium, search, Silent())
    assert seconds == 12.5 and cameras.names == data.cameras.names
    # Without --resume, or where nobody wrote down how long they took, they are searched for again.
    for again in (replace(search, resume=False), search):
        with pytest.raises(TooFewPhotos):
            kept_cameras(folder, data.photos[:2], data.medium, again, Silent())
        (folder.camera_folder / "seconds.json").unlink(missing_ok=True)


def test_mismatch_has_every_case(rendered_set, tmp_path):
    assert (
        run(
            [
                "compare",
                str(rendered_set),
                "--out",
                str(tmp_path),
                "--cameras",
                "known",
                "--quick",
                "--steps",
                "8",
                "--max-gaussians",
                "700",
                "--mismatch",
                "--threads",
                "1",
                "--progress",
                "none",
            ]
        )
        == 0
    )
    content = json.loads((tmp_path / "mismatch.json").read_text())
    assert set(content["cases"]) >= {"as given", "sigma given -20 %", "disc of the same variance", "noise 3 %"}
    assert all({"plain", "dgs"} <= set(each) for each in content["cases"].values())
    assert "DGS - plain" in (tmp_path / "mismatch.md").read_text()


def test_methods_are_named_and_unknown_ones_refused(rendered_set, tmp_path, capsys):
    assert {"plain", "paper", "dgs", "oracle"} < set(methods())
    assert {WIENER_MEASURED, LUCY_MEASURED} == set(CHOSEN) < set(methods())
    code = run(
        [
            "compare",
            str(rendered_set),
            "--out",
            str(tmp_path),
            "--cameras",
            "known",
            "--quick",
            "--only",
            "magic",
            "--progress",
            "none",
        ]
    )
    assert code == 2 and "magic" in capsys.readouterr().err


def test_a_set_without_truth_or_medium_says_what_to_do(rendered_set, tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    assert run(["compare", str(tmp_path), "--out", str(tmp_path / "out"), "--progress", "none"]) == 2
    assert "sharp" in capsys.readouterr().err
    (tmp_path / "bare").mkdir()
    for name in ("photos", "sharp"):
        (tmp_path / "bare" / name).symlink_to(rendered_set / name)
    assert run(["compare", str(tmp_path / "bare"), "--out", str(tmp_path / "out"), "--progress", "none"]) == 2
    assert "--psf" in capsys.readouterr().err
    code = run(
        [
            "compare",
            str(tmp_path / "bare"),
            "--out",
            str(tmp_path / "out"),
            "--psf",
            f"gaussian:{SIGMA}",
            "--cameras",
            "known",
            "--progress",
            "none",
        ]
    )
    assert code == 2 and "--cameras found" in capsys.readouterr().err
